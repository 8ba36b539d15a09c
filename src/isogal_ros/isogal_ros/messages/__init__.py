"""Messages to arrays and back.

stamps           which time does a stamp say, in whole nanoseconds?
prepared         how are serialised messages read and written without making objects?
frames           which frames and axes have messages, and which the library?
checks           what makes a message unusable?
imu              how is an inertial sample written and read?
position         how is a position with its covariance, also as a pose?
odometry         how is a navigation state?
aids             how are height, velocity, position and heading of sensors beside the IMU?
stamped_numbers  how is the covariance of the navigator's errors?
mounting         where do static transforms say that sensors are?
point            how are named numbers with a stamp, and a matcher's candidates?
fix_information  how is all that a fix says?
adapter          what do the messages of any field do, and which adapter has a field?
gravimeter       what are the messages of a gravimeter?
magnetometer     what are those of a magnetometer?
altimeter        what are those of an altimeter, of one beam or several?
gradiometer      what are those of a gradiometer?"""
