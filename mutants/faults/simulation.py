"""The bench of pokes: truth that would be wrong for everything that is judged by it."""

from mutants.fault import Fault, of

__all__ = ["FAULTS"]

FAULTS: list[Fault] = [
    *of(
        "simulation/forearm.py",
        "tests/simulation/test_poke_bench.py",
        ("the sheet is strained", "np.hypot(self.apex - t, s)", "self.apex - t"),
        ("tangents stay those of the middle", "c * away[:, 1] - s * away[:, 0]", "c * away[:, 1] + s * away[:, 0]"),
        (
            "others answer too",
            "cKDTree(skin.places.positions[others]).query(points)[0] > clear",
            "np.full(len(points), True)",
        ),
    ),
    *of(
        "simulation/poke_bench.py",
        "tests/simulation/test_poke_bench.py",
        ("cross-talk is transposed", "wrench @ self.cross_talk.T", "wrench @ self.cross_talk"),
        (
            "the error of the frame is on the sensor's side",
            "reported @ Pose.from_rotation_vector(self.frames[:, 3:].copy(), self.frames[:, :3])",
            "Pose.from_rotation_vector(self.frames[:, 3:].copy(), self.frames[:, :3]) @ reported",
        ),
        (
            "a tilted tip pulls",
            "np.maximum(deep[np.arange(count), last][:, None] - gap, 0.0)",
            "(deep[np.arange(count), -1][:, None] - gap)",
        ),
        ("spin is about the tip's middle", "y - cy[:, None]", "y"),
        ("stress falls as of a line", "near * near * np.sqrt(near)", "near * near * depth"),
        ("lever is left out of cross-talk", "[e.lever, 1.0]", "[1.0, 1.0]"),
    ),
    *of(
        "simulation/poke_log.py",
        "tests/simulation/test_poke_session_files.py",
        (
            "taxels press on while the force falls",
            "share[first + k] * touches.response[pairs]",
            "touches.response[pairs]",
        ),
        (
            "the bias grows with the force",
            "(session.pokes.wrench - bench.bias[row])[poke]",
            "session.pokes.wrench[poke]",
        ),
    ),
    *of(
        "simulation/barrel.py",
        "tests/simulation/test_barrel.py",
        ("below the equator the skin moves as above", "answer[rest.reshape(-1, 3)[:, 2] < 0.0, 2] *= -1.0", "pass"),
        ("every ring moves as its lowest brick", "levels[row[:, 0]], levels[row[:, 2]]", "levels[0], levels[2]"),
    ),
]
