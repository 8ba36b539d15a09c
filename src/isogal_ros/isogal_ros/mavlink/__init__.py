"""MAVLink: the navigator's position for a flight controller, and the sensors of one for the graph.

node        subscriptions, and the datagrams
settings    the node's own parameters
silence     when nothing may be sent
encoding    messages of the graph as messages of MAVLink
receiving   the datagrams of a flight controller, published on the graph's topics
decoding    messages of MAVLink as messages of the graph
"""
