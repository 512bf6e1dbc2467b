"""ROS 1's XML-RPC over asyncio: client, server and method dispatch."""
