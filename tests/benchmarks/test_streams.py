"""The table of streams is made: logs read and written, loops run, by us and by what a user would otherwise take."""

from claims.timings import streams


def test_every_row_of_the_table_has_its_time() -> None:
    lines = streams.report(300).splitlines()
    rows = [line.split("|")[1:-1] for line in lines if line.startswith("| ") and not line.startswith("| ---")]
    timed = [(name.strip(), spent.strip()) for name, spent, _ in rows if spent.strip() != "us"]
    assert len(timed) == 4 + 4 + 6
    assert all(float(spent.replace(",", "")) > 0.0 for _, spent in timed)
