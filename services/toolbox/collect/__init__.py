"""Collects pictures of live cameras for training, with a model's predictions as drafts of labels."""
