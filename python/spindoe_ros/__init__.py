"""A ball's orientation and spin in ROS 2: a node, and its core over recorded bags, which needs no ROS.

The node is the executable of the ament package in ``python/examples/ros2_spindoe``; ``python -m spindoe_ros.bag`` answers a bag.
"""
