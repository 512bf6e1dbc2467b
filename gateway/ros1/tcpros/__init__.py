"""ROS 1's data connections (TCPROS) on asyncio: publishers, subscribers and service calls."""
