"""Why nothing flows: evidence is collected with deadlines, judged by pure checks, and told in plain words.

Nothing here creates demand: no stream's key is subscribed to on the bus, and nothing is registered at the ROS master.
"""
