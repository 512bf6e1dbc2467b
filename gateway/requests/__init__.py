"""What a gateway answers when it is asked: what its clock shows, and what the ROS services that it may call say."""
