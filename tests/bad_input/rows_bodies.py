"""Bodies that nothing holds, and surfaces whose conditions contradict one another where they meet."""

from __future__ import annotations

from tests.bad_input.bad_row import faulty

WEDGE = {"kind": "wedge", "radius": 1, "height": 0.7, "elements": [1, 1, 1], "angle": 60}
#: Conditions that leave motions of the whole body free, and all of these.
FREE = {
    "a plane": (
        {"y-": {"normal": 0}},
        "in directions 1 and 3 and against a rotation about y; prescribe u_1 and u_3",
    ),
    "nothing": ({"y+": {"pressure": 0}}, "in directions 1, 2 and 3 and against a rotation about x, y and z"),
    "a rotation alone": (
        {
            "y-": {"displacement": [0, None, None]},
            "x-": {"displacement": [None, 0, None]},
            "z-": {"displacement": [None, None, 0]},
        },
        "nothing holds the body against a rotation about z; prescribe a displacement that this moves",
    ),
    "plates": ({"y-": {"normal": 0}, "x+": {"plate": 1}}, "in directions 1 and 3; prescribe u_1 and u_3"),
}
#: Conditions that contradict, and the surface beside that which is refused.
CONTRADICTIONS = {
    "values": (
        {"x+": {"normal": 1}, "y-": {"displacement": [0, 0, 0]}},
        "u_1 = 0 contradicts u_1 = 1 of macro.boundary.x+ where they meet",
    ),
    "a plate": (
        {"y+": {"plate": 1}, "x+": {"displacement": [None, 0, None]}, "y-": {"displacement": [0, None, 0]}},
        "macro.boundary.y+: the plate moves as one, but macro.boundary.x+ prescribes u_2 on their common edge",
    ),
}
#: What a body in two dimensions does not have.
PLUG = {"kind": "axisymmetric", "radius": 1, "height": 1, "elements": [1, 1]}
HELD_PLUG = {"y-": {"normal": 0}, "side": {"pressure": 0}}
FLAT = {
    "zero radius": ({"macro.body": PLUG | {"radius": 0}}, "macro.body.radius"),
    "no wall": (
        {"macro.body": PLUG | {"inner_radius": 1}},
        "inner_radius = 1 leaves nothing within radius = 1; make it smaller",
    ),
    "a normal on z": (
        {"macro.body": PLUG, "macro.boundary": HELD_PLUG | {"z-": {"normal": 0}}},
        "macro.boundary.z-",
    ),
    "a traction around": (
        {"macro.body": PLUG, "macro.boundary": HELD_PLUG | {"y+": {"traction": [0, 0, 1]}}},
        "macro.boundary.y+.traction: got a third component; an axisymmetric body has none around the axis",
    ),
    "a body force across": (
        {
            "macro.body": {"kind": "plane-strain", "size": [1, 1], "elements": [1, 1]},
            "macro.boundary": {"y-": {"displacement": [0, 0, 0]}},
            "macro.body_force": [0, 0, 1],
        },
        "macro.body_force: got a third component; a body in plane strain has none along z",
    ),
    "a side as symmetry plane": (
        {
            "macro.body": PLUG | {"symmetry": ["side"]},
            "macro.boundary": {"y-": {"normal": 0}, "side": {"normal": 0}},
        },
        "'side' is no symmetry plane, because it goes around the axis of revolution",
    ),
}
ROWS = [
    *(faulty(f"two dimensions: {name}", changes, part) for name, (changes, part) in FLAT.items()),
    *(faulty(f"free: {name}", {"macro.boundary": held}, part) for name, (held, part) in FREE.items()),
    faulty(
        "free: a wedge along its oblique plane",
        {"macro.body": WEDGE, "macro.boundary": {"oblique": {"normal": 0}, "y-": {"normal": 0}}},
        "nothing holds the body in direction (0.5, 0, 0.866)",
    ),
    *(
        faulty(f"contradiction: {name}", {"macro.boundary": held}, part)
        for name, (held, part) in CONTRADICTIONS.items()
    ),
]
