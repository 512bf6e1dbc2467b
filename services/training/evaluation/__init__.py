"""What a model's figures are: the same code for the model card and for the benchmark, whoever runs the model."""
