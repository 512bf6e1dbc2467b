"""From weights to objects: the same model under torch, ONNX Runtime, OpenVINO or TensorRT."""
