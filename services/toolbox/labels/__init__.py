"""Takes the labels of a data-set folder to the common labelling tools and back."""
