"""A detector worker against a bare loop over the same model."""
