"""MAVLink: the navigator's position for a flight controller, and the sensors of one for the graph.

node      parameters, subscriptions, datagrams that are sent, and when nothing may be
encoding  messages of the graph as messages of MAVLink
decoding  datagrams of a flight controller, published on the graph's topics
"""
