"""The network that makes the model's masks finer: trained on what the model finds in scenes of their own."""
