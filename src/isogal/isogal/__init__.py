"""Isogal: navigation by map matching when there is no GNSS.

Conventions of the whole package, stated once:

Frames
    n     navigation frame: north, east, down (NED) at the vehicle.
    b     body frame: x forward, y right, z down. (ROS messages use x forward, y left, z up; the
          nodes convert.)
    e     Earth-centred Earth-fixed, GRS80.
    Attitude is the quaternion (w, x, y, z) that turns body vectors into n.
Units
    SI and radians everywhere inside. 1 mGal = 1e-5 m/s². Degrees, mGal and km only at the edges
    and then said in the name (``latitude_deg``, ``sigma_mgal``). A position is (latitude rad,
    longitude rad, height m above the ellipsoid).
Axes of arrays
    What is simulated of many runs, and their record, has a leading run axis R: ``(R, K, 3)``. A
    navigator is of one run. The numbers of a run never depend on which others are computed with
    it.
Errors
    An error is estimate minus truth. Horizontal vectors and 2 x 2 covariances are ordered north,
    east; only messages and files that say ENU are ordered east, north.
Sources are cited by the labels of the paper (Wang et al., NAVIGATION 70(2), navi.583) as "paper
eq. s3-01", and by book section."""

__version__ = "0.1.0"
