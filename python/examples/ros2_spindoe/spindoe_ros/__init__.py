"""A ROS 2 node that publishes a ball's orientation and spin."""
