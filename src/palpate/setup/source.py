"""The [source] of a rig: the device that live samples come from."""

from __future__ import annotations

import json
from dataclasses import dataclass

from palpate.setup.tables import require_positive

FRAMINGS = ("cobs", "lines")
_MORE = {  # options in addition to kind and address, as comments
    "netft": "# port = 49152                      # of samples\n# web = 80                          # of its page\n",
    "serial": '# baud = 115200\n# framing = "cobs"                  # or "lines" of numbers\n',
    "ros2": '# domain = 0\n# interface = "eth0"                # of the network; without it this machine alone\n',
    "camera": "# rate = 30                         # Hz\n",
    "replay": "# speed = 1.0                       # 0: as fast as it goes\n# loop = false\n",
}


@dataclass(frozen=True)
class RigSource:
    """The [source] of a rig: a device that sends live samples, or a log that is replayed.

    `address`: name or address of a Net F/T; file of a serial port; number or file of a camera; log to replay. ROS 2 has
    none: the sensor's table and [orientation] name its topics.
    `rate` [Hz] is requested from the device, or a log without times is replayed at it.
    Net F/T: `port` of its samples (RDT), `web` of its page. Serial: `baud`, and `framing`: "cobs" (frames with COBS and
    CRC-32) or "lines" of numbers; `columns`: indices of the numbers in a line, from 0. ROS 2: `domain`, and `interface`
    of the network. Replay: `speed` (0: as fast as possible), `loop`.
    `wrench` is the source of the wrenches where the [source] sends only the skin's samples; None: it sends both.

    Raises:
        ValueError: a value is unknown or out of bounds, or the address is missing.
    """

    kind: str
    address: str = ""
    rate: float | None = None
    port: int = 49152
    web: int = 80
    baud: int = 115200
    framing: str = "cobs"
    columns: tuple[int, ...] | None = None
    domain: int = 0
    interface: str = ""
    speed: float = 1.0
    loop: bool = False
    wrench: RigSource | None = None

    def __post_init__(self) -> None:
        if self.kind not in _MORE:
            raise ValueError(f"kind must be one of {', '.join(_MORE)}, not {self.kind!r}")
        if self.framing not in FRAMINGS:
            raise ValueError(f"framing must be one of {', '.join(FRAMINGS)}, not {self.framing!r}")
        if not self.address and self.kind != "ros2":
            raise ValueError(f"a {self.kind} needs an address")
        if not (0 < self.port < 2**16 and 0 < self.web < 2**16):
            raise ValueError("ports must be between 1 and 65535")
        if not 0 <= self.domain <= 232:
            raise ValueError("domain must be between 0 and 232")
        if self.speed < 0:
            raise ValueError("speed must not be negative; 0 is as fast as it goes")
        if self.columns is not None and (not self.columns or min(self.columns) < 0):
            raise ValueError("columns must not be negative: they are counted from 0")
        if self.wrench is not None and "replay" in (self.kind, self.wrench.kind):
            raise ValueError("a log that is replayed has its own wrenches and frames: leave [source.wrench] out")
        require_positive(self, "rate", "baud")

    def text(self) -> str:
        """Return the table as TOML text, with the kind's other options as comments."""
        address = f"address = {json.dumps(self.address)}\n" if self.address else ""
        head = "\n[source]                             # of `palpate live`\n"
        return f'{head}kind = "{self.kind}"\n{address}{_MORE[self.kind]}'
