"""A model of MuJoCo with every way to state a pose, a joint and its class, and its poses by MuJoCo 3.17."""

MODEL = """\
<?xml version="1.0"?>
<!-- a comment with <body> -->
<mujoco model="weird">
  <compiler angle="degree" eulerseq="XYz" autolimits="true"/>
  <option gravity="0 0 -9.81"/>
  <default>
    <joint damping="1" axis="0 1 0"/>
    <default class="arm">
      <joint axis="0 0 1" range="-170 170"/>
      <default class="slide"><joint type="slide" axis="1 0 1"/></default>
      <default class="off"><joint ref="20" pos="0.01 0.02 0.03"/></default>
    </default>
  </default>
  <worldbody>
    <light pos="0 0 1"/>
    <site name="origin" pos="0 0 0"/>
    <body name="base" pos="0.1 0 0.2" euler="10 20 30" childclass="arm">
      <geom type="box" size="0.01 0.02 0.03" mass="1"/>
      <body name="l1" pos="0 0 0.3" axisangle="1 1 0 40">
        <joint name="j1"/>
        <geom type="capsule" size="0.02 0.1"/>
        <frame pos="0 0.1 0" euler="0 0 90">
          <body name="l2" pos="0.2 0 0" xyaxes="0 1 0 -1 0.1 0">
            <inertial pos="0 0 0" mass="0.5" diaginertia="1e-3 1e-3 1e-3"/>
            <joint class="off" name="j2" axis="1 0 0" range="-100 120"/>
            <geom type="capsule" size="0.02 0.1"/>
            <body name="l3" pos="0.25 0.01 0" zaxis="1 0.2 0.3">
              <joint name="j3" ref="-10"/>
              <geom type="capsule" size="0.02 0.1"/>
              <body name="l4" pos="0 0 0.2" quat="1 1 0 0.5">
                <joint name="rail" class="slide" range="-0.2 0.3" ref="0.05" pos="0.3 0 0"/>
                <geom type="capsule" size="0.02 0.1"/>
                <body name="l5" pos="0 0.1 0">
                  <joint name="j5" axis="0 1 0.5"/>
                  <geom type="capsule" size="0.02 0.1"/>
                  <body name="hand" pos="0 0 0.1" euler="5 6 7">
                    <geom type="capsule" size="0.02 0.1"/>
                    <site name="attachment_site" pos="0.01 0 0.05" euler="0 90 0"/>
                  </body>
                </body>
              </body>
            </body>
          </body>
        </frame>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
JOINTS = ("j1", "j2", "j3", "rail", "j5")
# Joints [rad, rail m] and `attachment_site` in the world [m], by mujoco.mj_kinematics.
POSES = (
    ((0, 0, 0, 0, 0), (-0.037442151100591334, -0.17892939563308113, 1.0628956282539748)),
    ((0.5, -0.4, 0.3, 0.1, -0.6), (-0.08395888082833271, -0.47268890469897373, 0.9473667890519211)),
    ((-1, 0.9, 1.2, -0.15, 0.7), (0.19931988959455535, 0.40756128956053506, 0.924832039022457)),
)
