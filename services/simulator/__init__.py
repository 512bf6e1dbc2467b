"""Robots that are not there, in rendered warehouses on a real ROS 1 graph, and the training of the shipped model."""
