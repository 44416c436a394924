"""A MuJoCo model with all kinds of geoms, and the files that it names."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

OBJ = """v 0 0 0\nv .3 0 0\nv .3 .3 .05\nv 0 .3 0\nv .3 0 -.1
vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\nf 1/1 5/2 2/3\n"""

MODEL = """<mujoco><statistic extent="1" center="0 0 0"/>
<visual><map znear=".01" zfar="30"/><quality numslices="64" numstacks="64"/></visual>
<asset>
  <texture name="letters" type="2d" file="letters.png"/>
  <texture name="die" type="cube" file="die.png" gridsize="6 1" gridlayout="RLUDFB"/>
  <material name="tiles" texture="letters" texrepeat="3 5"/>
  <material name="even" texture="letters" texrepeat="6 4" texuniform="true"/>
  <material name="die" texture="die"/>
  <material name="dyed" texture="die" texuniform="true" rgba=".9 .5 .7 1"/>
  <material name="print" texture="letters"/>
  <material name="steel" rgba=".7 .7 .7 1" metallic="1" roughness=".2"/>
  <material name="glaze" rgba=".7 .7 .7 1" roughness=".1"/>
  <mesh name="sheet" file="sheet.obj"/>
  <hfield name="hills" nrow="5" ncol="6" size=".1 .1 .05 .02"
    elevation="0 0 0 0 0 0  0 1 1 0 0 0  0 1 1 .5 .5 0  0 0 0 .5 .5 0  0 0 0 0 0 0"/>
</asset>
<worldbody>
  <geom name="floor" type="plane" size="0 0 .1" material="tiles"/>
  <geom name="mat" type="plane" size=".25 .15 .1" pos="-.6 .5 .02" material="tiles"/>
  <geom name="box" type="box" size=".1 .06 .08" pos="-.3 -.1 .2" euler="20 30 10" material="die"/>
  <geom name="dyed" type="box" size=".1 .06 .08" pos=".1 -.2 .2" euler="20 30 10" material="dyed"/>
  <geom name="tiled" type="box" size=".1 .06 .08" pos=".4 -.1 .2" euler="20 30 10"
    material="tiles"/>
  <geom name="capsule" type="capsule" size=".06 .1" pos="0 .3 .2" euler="60 0 20"
    material="even"/>
  <geom name="lid" type="cylinder" size=".06 .1" pos=".25 .3 .2" euler="60 0 20"
    material="even"/>
  <geom name="egg" type="ellipsoid" size=".06 .1 .08" pos=".5 .3 .2" euler="60 0 20"
    material="tiles"/>
  <geom name="sheet" type="mesh" mesh="sheet" pos=".55 0 .1" material="print"/>
  <geom name="hills" type="hfield" hfield="hills" pos="-.5 -.3 .1" euler="0 0 20"
    rgba=".2 .6 .2 1"/>
  <geom name="steel" type="box" size=".03 .03 .03" pos="-.1 -.4 .1" material="steel"/>
  <geom name="glaze" type="box" size=".03 .03 .03" pos=".2 -.4 .1" material="glaze"/>
  <geom name="hull" type="box" size=".4 .4 .4" group="3"/>
  <geom name="clear" type="box" size=".4 .4 .4" rgba="1 1 1 0"/>
  <body name="ball" pos="-.35 .3 .2"><freejoint/>
    <geom type="sphere" size=".1" euler="10 60 20" material="die"/></body>
  <camera name="top" pos="0.1 -.6 1.2" xyaxes="1 0 0 0 .8 .5" resolution="320 240" fovy="60"/>
  <camera name="shifted" pos="0.1 -.6 1.2" xyaxes="1 0 0 0 .8 .5" resolution="320 240"
    sensorsize=".004 .003" focal=".003 .0027" principal=".0005 -.0003"/>
  <camera name="plain" pos="0.1 -.6 1.2" xyaxes="1 0 0 0 .8 .5" fovy="50"/>
  <camera name="sky" pos="0 0 2" xyaxes="1 0 0 0 -1 0"/>
  <camera name="flat" pos="0 0 2" projection="orthographic" fovy="1"/>
</worldbody>
<keyframe><key name="lifted" qpos="-.35 .3 .4 1 0 0 0"/></keyframe></mujoco>"""


def assets() -> dict[str, bytes]:
    """Files that the model names."""
    colours = ((220, 60, 40), (60, 200, 60), (60, 80, 220), (230, 220, 60))
    letters = np.zeros((64, 128, 3), np.uint8)
    for number, colour in enumerate(colours):
        row, column = 32 * (number // 2), 64 * (number % 2)
        letters[row : row + 32, column : column + 64] = colour
    cv2.putText(letters, "AB", (20, 45), 0, 1.2, (255, 255, 255), 3)
    dyes = (*colours, (220, 40, 220), (40, 220, 220))
    faces = [np.full((32, 32, 3), colour, np.uint8) for colour in dyes]
    for face, letter in zip(faces, "RLUDFB", strict=True):
        cv2.putText(face, letter, (6, 26), 0, 0.9, (255, 255, 255), 2)
    images = {"letters.png": letters, "die.png": np.concatenate(faces)}
    encoded = {name: cv2.imencode(".png", image[..., ::-1])[1] for name, image in images.items()}
    return {"sheet.obj": OBJ.encode(), **{name: data.tobytes() for name, data in encoded.items()}}


def write(folder: Path) -> Path:
    """Write the model and the files that it names, and return its path."""
    for name, content in assets().items():
        (folder / name).write_bytes(content)
    (folder / "bench.xml").write_text(MODEL)
    return folder / "bench.xml"
