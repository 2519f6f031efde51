"""Small models for the tests of this folder."""

HOPPER = """
<mujoco model="hopper">
  <compiler angle="degree"/>
  <custom>
    <text name="contact_left" data="left_toe"/>
    <text name="contact_right" data="right_toe"/>
    <numeric name="front" data="2 0 0"/>
  </custom>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 1" friction="0.7"/>
    <body name="base" pos="0 0 0.03">
      <freejoint name="root"/>
      <geom type="cylinder" size="0.1 0.03" mass="1.5"/>
      <site name="contact_left" pos="0 0.1 -0.03"/>
      <site name="contact_right" pos="0 -0.1 -0.03"/>
      <site name="contact_back" pos="-0.1 0 -0.03"/>
      <body name="arm" pos="0 0 0.03">
        <joint name="hip" type="hinge" axis="0 1 0" range="-100 100" limited="true"
               damping="0.3" stiffness="2"/>
        <geom type="capsule" fromto="0 0 0 0.05 0 0.25" size="0.02" mass="0.4"/>
        <body name="head" pos="0.05 0 0.25">
          <joint name="neck" type="ball" pos="0 0 0.01"/>
          <geom type="box" pos="0.04 0 0.02" size="0.08 0.05 0.04" mass="0.6"/>
          <body name="slider" pos="0 0.05 0.02" euler="10 20 30">
            <joint name="slide" type="slide" axis="1 0 1" ref="0.1"/>
            <joint name="twist" type="hinge" axis="0 1 1" pos="0.01 0.02 0" ref="15"/>
            <geom type="sphere" size="0.03" mass="0.2" pos="0.02 0 0.01"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""

FIXED_ARM = """
<mujoco>
  <worldbody>
    <body name="stand">
      <geom type="box" size="0.1 0.1 0.1" mass="3"/>
      <body name="arm" pos="0 0 0.1">
        <joint type="hinge" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0.1" size="0.03" mass="1"/>
        <body pos="0.3 0 0.1">
          <joint type="ball"/>
          <geom type="capsule" fromto="0 0 0 0.3 0 0.1" size="0.03" mass="1"/>
        </body>
      </body>
    </body>
    <body name="prop" pos="2 0 1">
      <joint type="slide"/>
      <geom type="sphere" size="0.1" mass="9"/>
    </body>
  </worldbody>
</mujoco>
"""

TWO_TREES = """
<mujoco>
  <worldbody>
    <body name="ball" pos="3 0 1"><freejoint/><geom size="0.5"/></body>
    <body name="torso" pos="0 0 1">
      <freejoint/>
      <geom size="0.1"/>
      <body pos="0.2 0 0"><joint axis="0 0 1"/><geom size="0.05" pos="0.1 0 0"/>
        <body pos="0.2 0 0"><geom size="0.05"/></body></body>
      <body pos="-0.2 0 0"><joint axis="0 1 0"/><geom size="0.05" pos="-0.1 0 0"/></body>
    </body>
  </worldbody>
  <keyframe>
    <key name="other" qpos="3 0 1 1 0 0 0  0 0 5 1 0 0 0 0 0"/>
    <key name="stand" qpos="3 0 1 1 0 0 0  0 0 2 1 0 0 0 0.5 0"/>
  </keyframe>
</mujoco>
"""
