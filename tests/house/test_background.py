"""Motion that stays in one place becomes background, as docs/what-stops-an-alarm.md says."""

import pytest

from tests.radar_helpers import run_radard


@pytest.mark.parametrize(("empty_s", "closed_s"), [(0, 24), (70, 31)])
def test_motion_in_one_place_becomes_background(empty_s, closed_s, tmp_path):
    walk = "{body: human, style: walk, waypoints_m: [[0.3, 4.8], [0.0, 2.0]], speed_mps: 0.9"
    here = "{body: human, style: exercise, waypoints_m: [[0.0, 2.0], [0.0, 2.01]]"
    lead = f"  - {{duration_s: {empty_s}}}\n  - {walk}, duration_s: 4}}\n" if empty_s else ""
    scene = tmp_path / "exercise.yaml"
    scene.write_text(f"like: empty\nsteps:\n{lead}  - {here}, duration_s: 90}}\n")
    began_s = empty_s + 4 if empty_s else 0
    argv = ["--port", f"sim:{scene}", "--duration", str(began_s + closed_s + 20)]
    code, records, _ = run_radard(*argv, "--speed", "max", "-o", "json")
    assert code == 0
    open_s = [r["t_s"] for r in records if r["type"] == "decision" and r["gate"] == "open"]
    assert max(open_s) == pytest.approx(began_s + closed_s, abs=1.6)
    events = [r for r in records if r["type"] == "event"]
    assert [e["phase"] for e in events] == ["new", "update", "end"]
    assert events[-1]["reason"] == "nobody seen for 15 s"
