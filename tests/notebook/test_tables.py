"""The tables that a notebook shows: sound HTML, names escaped, the numbers those of the result."""

from xml.etree import ElementTree

import numpy as np
import pytest
from test_results import RESULTS

import spacearm as sa
from spacearm.notebook.tables import joint_value, table

KINDS = ("SpaceArm", "SingularityReport", "SingularSet", "FoundSet", "Motion", "Trajectory", "Plan")
HOSTILE = """<robot name="a&lt;script&gt;b">
  <link name="base"><inertial><mass value="9"/>
    <inertia ixx="9" iyy="9" izz="9" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="&lt;b&gt;&amp;&quot;tip"><inertial><mass value="2"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="&lt;img src=x&gt;" type="prismatic"><parent link="base"/>
    <child link="&lt;b&gt;&amp;&quot;tip"/><axis xyz="0 0 1"/>
    <limit lower="-0.25" upper="0.5" velocity="1" effort="1"/></joint>
</robot>"""


def cells(thing):
    """The rows of all tables of a thing, as texts; the HTML must be well formed."""
    root = ElementTree.fromstring(thing._repr_html_())
    return [[cell.text or "" for cell in row] for row in root.iter("tr")]


@pytest.mark.parametrize("kind", KINDS)
def test_results_are_shown_as_sound_html(kind):
    thing = RESULTS[kind]()
    root = ElementTree.fromstring(thing._repr_html_())
    assert root.find("strong").text
    for part in root.iter("table"):
        assert len({len(row) for row in part.iter("tr")}) == 1


def test_names_of_a_file_are_text_and_no_markup(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(HOSTILE)
    arm = sa.load(path, task="z")
    for thing in (arm, sa.singularity(arm.at([0.1]))):
        assert {e.tag for e in ElementTree.fromstring(thing._repr_html_()).iter()} <= {
            "div", "strong", "table", "tr", "th", "td"
        }  # fmt: skip
        assert any("<img src=x>" in cell for row in cells(thing) for cell in row)
    assert ["<img src=x>", "-0.25 m", "0.5 m"] in cells(arm)


def test_a_report_shows_the_posture_the_way_out_and_the_lost_direction():
    report = sa.singularity(sa.load("planar2").at(np.radians([-65, -11.41])), exact=True)
    rows = cells(report)
    (joint,) = (row for row in rows if row[0] == "joint_2")
    assert joint[1].startswith("-11.41°")
    np.testing.assert_allclose(float(joint[2].split("°")[0]), -11.411, atol=1e-3)  # nearest
    assert joint[3].startswith("57.")  # degrees a radian
    (lost,) = (row for row in rows if row[0] == "lost")
    np.testing.assert_allclose(np.array(lost[2:], float), report.lost[:, 0], atol=1e-4)


def test_a_plan_shows_what_was_tried_and_how_it_moves():
    plan = RESULTS["Plan"]()
    rows = cells(plan)
    assert [row[0] for row in rows[-len(plan.tried) :]] == [a.method for a in plan.tried]
    (joint,) = (row for row in rows if row[0] == "joint_1")
    assert joint[1:3] == [joint_value(plan.q[0, 0], False), joint_value(plan.q[-1, 0], False)]


def test_values_have_units_and_a_limit_that_is_none_says_so():
    assert joint_value(np.pi, False) == "180° (3.1416 rad)"
    assert joint_value(0.125, True) == "0.125 m"
    assert joint_value(-np.inf, False) == "none"
    assert table(("", ""), [("a<b", np.array([1.0, 2.5]))]) == (
        "<table><tr><td>a&lt;b</td><td>(1, 2.5)</td></tr></table>"
    )
