"""How far away what a detector found is, and where: detections joined with depth, by time and by geometry."""
