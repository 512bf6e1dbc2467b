"""Simulates robots in rendered warehouses on a real ROS 1 graph; its worlds train the shipped model."""
