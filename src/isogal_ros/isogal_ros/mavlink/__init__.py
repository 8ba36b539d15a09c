"""The navigator's position for a flight controller, as MAVLink.

node        subscriptions, and the datagrams
silence     when nothing may be sent
encoding    messages of the graph as messages of MAVLink
"""
