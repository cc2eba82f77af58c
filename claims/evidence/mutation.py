"""How good files are spoilt: `mutate` draws from the ways of their kind."""

from functools import partial

from claims.evidence.mutation_bytes import ANY, Mutation, Random, corners, count, double
from claims.evidence.mutation_mcap import MCAP
from claims.evidence.mutation_text import ASCII, PAYLOAD, TABLE, TOML

WAYS: dict[str, tuple[Mutation, ...]] = {
    "table": TABLE,
    "toml": TOML,
    "payload": PAYLOAD,
    "stl": (corners, corners, partial(count, first=80, last=80), partial(double, kind="<f"), count),
    "ascii": ASCII,
    "binary": (count, double, partial(count, size=8), partial(count, size=2)),
    "mcap": MCAP,
}


def mutate(data: bytes, ways: str, random: Random) -> bytes:
    """One to four mutations, three in four of them in one of the `WAYS`."""
    for _ in range(int(random.choice([1, 1, 1, 2, 4]))):
        some = WAYS[ways] if random.random() < 0.75 else ANY
        data = some[int(random.integers(len(some)))](data, random)
    return data
