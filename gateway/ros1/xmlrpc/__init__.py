"""ROS 1's XML-RPC over asyncio: client, server and the dispatch of its methods."""
