"""What a robot's radio does to class lists: a thin link, and one that is gone for a while."""
