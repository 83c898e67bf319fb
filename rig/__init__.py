"""Joint angles in, volts out: the arm, its maneuvers, the fields, the sensors and the recording of what they read.

- ``rig.recording``: ``read_recording(path)``, ``Recording``, ``Metadata``.
- ``rig.arm``, ``rig.arm_file``: the A465-like arm, and any other from a URDF or MJCF.
- ``rig.maneuver``, ``rig.environment``, ``rig.sensor``, ``rig.acquisition``: what a scenario is made of.
- ``rig.effects``: what a model leaves out, one class each.
- ``rig.simulate``: a maneuver in, a recording out.
- ``rig.errors``: ``RigError``, of which every refusal is one.
"""
