"""URDFs of arms that tests drive: six joints in the manner of Elfin3, and one that slides and turns for ever."""

from pathlib import Path


def joint(name: str, kind: str, parent: str, child: str, *, more: str = "", limit: str | None = None) -> str:
    """One <joint>; `more` holds its origin and axis."""
    bound = 'lower="-2.5" upper="2.6" effort="1" velocity="1.57"' if limit is None else limit
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{more}{f"<limit {bound}/>" if bound else ""}</joint>'


def _links(*names: str) -> str:
    return "".join(f'<link name="{name}"/>' for name in names)


def _at(xyz: str, rpy: str = "0 0 0", axis: str = "0 0 1") -> str:
    return f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>'


JOINTS = tuple(f"joint{k}" for k in range(1, 7))
_PLACES = (
    _at("0 0 0.19"),
    _at("0 0 0.03", "1.5708 0 0.1"),
    _at("0 0.27 0.01", "0 0.2 3.1416"),
    _at("0 -0.05 0", "1.5708 0 0", "0 0 -1"),
    _at("0 0.01 0.25", "-1.5708 0.1 0", "0.6 0 0.8"),
    _at("0 -0.03 0", "1.5708 0 0"),
)
SIX = "".join(
    (
        '<robot name="six">',
        _links("world", "base", *(f"link{k}" for k in range(1, 7)), "ft"),
        joint("ground", "fixed", "world", "base", more=_at("0.1 0 0.5", "0 0 0.7"), limit=""),
        *(
            joint(name, "revolute", f"link{k}" if k else "base", f"link{k + 1}", more=place)
            for k, (name, place) in enumerate(zip(JOINTS, _PLACES, strict=True))
        ),
        joint("mount", "fixed", "link6", "ft", more=_at("0 0 0.07", "0.3 0 0.2"), limit=""),
        "</robot>",
    )
)
SLIDING = "".join(
    (
        '<robot name="sliding">',
        _links("a", "b", "c", "d", "ft"),
        joint("lift", "prismatic", "a", "b", more=_at("0 0.1 0.2", "0.3 0.2 0.1", "0.6 0.8 0")),
        joint("spin", "continuous", "b", "c", more=_at("0.3 0 0.1", "1 0 0"), limit='effort="1" velocity="2"'),
        joint("reach", "prismatic", "c", "d", more=_at("0.2 0 0", "0 0.5 0", "1 0 0")),
        joint("wrist", "revolute", "d", "ft", more=_at("0.1 0.1 0", "0 0 1", "0 1 0")),
        "</robot>",
    )
)


def write_arm(folder: Path, text: str = SIX) -> Path:
    """The file."""
    path = folder / "arm.urdf"
    path.write_text(text, encoding="utf-8")
    return path
