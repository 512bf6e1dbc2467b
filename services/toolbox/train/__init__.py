"""The training of the shipped model, which is evaluated through the detector that it is for."""
