from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from physretarget.capture.actor import ActorShape
from physretarget.mjcf import Character, actor_character
from physretarget.mjcf.audit import AUDIT_KEYS, audit
from physretarget.mjcf.solids import inertia_box_volume

BOX = "<inertial pos='{pos}' mass='{mass}' diaginertia='{inertia}'/>"
MODEL = """
<mujoco model="m">
  <compiler {compiler}/>
  <option gravity="{gravity}"/>
  <asset>{assets}</asset>
  <worldbody>
    {floor}
    <body name="base" pos="0 0 0.5">
      {root}
      <geom type="box" size="{size}" {geom}/>
      {base}
      <body name="arm" pos="0 0 0.2">
        <joint name="hinge" axis="0 1 0" {joint}/>
        {arm}
      </body>
    </body>
  </worldbody>
  <actuator>{motor}</actuator>
</mujoco>
"""
CLEAN = {
    "compiler": "",
    "gravity": "0 0 -9.81",
    "assets": "",
    "floor": "<geom type='plane' size='0 0 1'/>",
    "root": "<freejoint/>",
    "size": "0.1 0.1 0.1",
    "geom": "",
    "base": "",
    "joint": "range='-1 1' limited='true' damping='0.01'",
    "arm": "<geom type='capsule' fromto='0 0 0 0 0 0.3' size='0.05'/>",
    "motor": "<motor joint='hinge' ctrllimited='true' ctrlrange='-5 5'/>",
}
GHOST = "contype='0' conaffinity='0'"
SOLID = "<geom type='box' size='0.05 0.05 0.05'/>"


def keys(**changed: str) -> set[str]:
    facts = audit(Character.from_xml(MODEL.format(**CLEAN | changed)))
    assert all(fact.key in AUDIT_KEYS and fact.message and fact.name for fact in facts)
    return {fact.key for fact in facts}


def test_a_sound_model_has_no_facts() -> None:
    assert keys() == set()


def inertial(mass: float, inertia: str, pos: str = "0 0 0") -> str:
    return BOX.format(pos=pos, mass=mass, inertia=inertia) + SOLID


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({"gravity": "0 0 9.81"}, {"gravity"}),
        ({"floor": ""}, {"no_floor"}),
        ({"root": ""}, {"no_root"}),
        ({"root": "<joint type='free' damping='0.1'/>"}, {"root_passive"}),
        ({"size": "30 30 30"}, {"size"}),
        ({"joint": "damping='0.01'"}, {"limit_missing"}),
        ({"motor": ""}, {"torque_limit_missing"}),
        ({"joint": CLEAN["joint"] + " actuatorfrcrange='-5 5'", "motor": ""}, set()),
        ({"joint": "range='-1 1' stiffness='200' damping='5'"}, {"pd_gains"}),
        ({"joint": "range='-1 1' stiffness='5' damping='0.1'"}, set()),
        ({"joint": "range='-1 1' damping='50'"}, {"pd_gains"}),
        ({"arm": inertial(1e-5, "1e-9 1e-9 1e-9")}, {"mass_light"}),
        ({"arm": inertial(1, "1e-3 1e-3 1e-3")}, set()),
        ({"arm": inertial(1, "1 1 1")}, {"inertia_reach"}),
        ({"arm": inertial(1, "1e-3 1e-3 1e-3", "0 0 0.5")}, {"com_outside"}),
        ({"arm": inertial(0.01, "1e-5 1e-5 1e-5")}, {"density_low"}),
        ({"arm": inertial(100, "1e-1 1e-1 1e-1")}, {"density_high"}),
        ({"arm": BOX.format(pos="0 0 0", mass=1, inertia="1 1 1")}, {"density_unknown"}),
        ({"geom": GHOST, "arm": SOLID.replace("/>", f" {GHOST}/>")}, {"no_contact_geometry"}),
    ],
)  # fmt: skip
def test_each_oddity_is_found_and_no_other(changed: dict[str, str], expected: set[str]) -> None:
    compiler = {"compiler": "autolimits='true'"}
    assert keys(**compiler, **changed) == expected


def test_a_declared_contact_point_is_enough() -> None:
    arm = SOLID.replace("/>", f" {GHOST}/>") + "<site name='contact_tip'/>"
    assert keys(geom=GHOST, arm=arm) == set()


def test_inertia_that_no_body_has() -> None:
    """MuJoCo refuses such a file; compiled models and other tools' need not come from it."""
    character = Character.from_xml(MODEL.format(**CLEAN))
    character.model.body_inertia[2] = [1e-4, 1e-4, 1e-3]
    facts = [fact for fact in audit(character) if fact.key == "inertia_triangle"]
    assert [fact.name for fact in facts] == ["arm"]
    assert facts[0].value == pytest.approx(5.0)


def meshed(folder: Path, mesh: trimesh.Trimesh, body: str = "") -> set[str]:
    mesh.export(folder / "m.stl")
    text = MODEL.format(
        **CLEAN
        | {
            "assets": "<mesh name='m' file='m.stl'/>",
            "arm": body + "<geom type='mesh' mesh='m'/>",
        }
    )
    (folder / "model.xml").write_text(text)
    return {fact.key for fact in audit(Character.load(folder / "model.xml"))}


def test_meshes(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(radius=0.1)
    assert meshed(tmp_path, ball) == set()
    holed = trimesh.Trimesh(ball.vertices, ball.faces[5:])
    assert meshed(tmp_path, holed) == {"mesh_open", "density_unknown"}
    dense = BOX.format(pos="0 0 0", mass=3, inertia="1e-3 1e-3 1e-3")
    assert meshed(tmp_path, ball, dense) == {"mesh_volume"}


def test_box_of_an_inertia() -> None:
    a, b, c, mass = 0.1, 0.2, 0.3, 2.0
    moments = tuple(mass / 12 * (x * x + y * y) for x, y in ((b, c), (a, c), (a, b)))
    assert inertia_box_volume(mass, moments) == pytest.approx(a * b * c)
    ball = 4 / 3 * np.pi
    assert ball / inertia_box_volume(1.0, (0.4, 0.4, 0.4)) == pytest.approx(1.126, abs=1e-3)


def test_the_actor_is_a_sound_body() -> None:
    found = {fact.key for fact in audit(actor_character(ActorShape.reference()))}
    assert found == {"limit_missing", "torque_limit_missing"}


def test_robot_with_gains_and_without_floor(data: Path) -> None:
    facts = audit(Character.load(data / "robot" / "g1_no_mesh_box_feet.xml"))
    found = [fact.key for fact in facts]
    assert found.count("pd_gains") == 29
    assert "no_floor" in found
    assert set(found) == {"pd_gains", "no_floor", "density_unknown"}


@pytest.mark.parametrize("name", ["lamp", "penguin", "squirrel"])
def test_our_own_models_are_sound(name: str) -> None:
    path = Path(__file__).parents[2] / "models" / f"{name}.xml"
    facts = audit(Character.load(path, untrusted=True))
    assert {fact.key for fact in facts} <= {"torque_limit_missing"}


def test_every_fact_is_documented() -> None:
    page = (Path(__file__).parents[2] / "docs" / "measures.md").read_text()
    for key, what in AUDIT_KEYS.items():
        assert f"| `{key}` | {what} |" in page
