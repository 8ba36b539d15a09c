"""ROS parameters declared from pydantic models, so that a scenario key is described, typed and
checked in one place.

A nested model becomes dotted names (``matcher.batch_length``). What ROS parameters cannot hold is
written thus:

- a number that may be null is 0 where it is null (such numbers are positive),
- a text that may be null is empty where it is null,
- a number that may also be a word (``matcher.map_sigma: auto``) is dynamically typed,
- errors of inertial sensors (``imu.gyroscope.bias``) are dynamically typed: a number, a text with
  a unit or three of them, and an empty text where they are null,
- anything nested (``route.waypoints``, ``matcher.options``) is a string that holds YAML, empty
  where it is null or has no entries.

from_model   which parameters has a model, and how does a value become a parameter's?
declaration  how are they declared on a node, and changed while it runs?
values       which values has a scenario, and which scenario do values make?"""
