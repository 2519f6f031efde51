"""What the floor can do: where a character may touch it, and which wrench that gives.

The one owner of contact with the floor, for stages that move a body and for the judge of the
result, so that the two cannot disagree.

* :mod:`~physretarget.ground.undersides`: the geometry that may touch, and its lowest points
* :mod:`~physretarget.ground.contacts`: points that touch, frame by frame
* :mod:`~physretarget.ground.support`: where force may act to explain a frame
* :mod:`~physretarget.ground.cones`: forces in friction cones that explain a wrench best
* :mod:`~physretarget.ground.wrench`: what the floor must supply, about the centre of mass
* :mod:`~physretarget.ground.response`: what differences and a low-pass make of a force
* :mod:`~physretarget.ground.sliding`: loaded bodies that move along the floor
"""
