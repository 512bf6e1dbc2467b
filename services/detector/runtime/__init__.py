"""Runs a model from weights to objects under torch, ONNX Runtime, OpenVINO or TensorRT."""
