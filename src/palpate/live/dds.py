"""Join a domain of DDS, the network of ROS 2, through cyclonedds."""

from __future__ import annotations

import os
import re
import socket
import time
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from importlib import import_module
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from palpate.errors import InputError, importing_extra
from palpate.files.messages import MessageBlock, Topic
from palpate.live.ros_messages import idl_type, ros_type_name

DEPTH = 8192  # messages that wait in a reader, at most: 1.2 s at 7 kHz
LOOPBACK = "127.0.0.1"
_PARTICIPANTS = 32  # on one machine, that find each other without multicast
_FAST_DDS = "1.15"  # as a vendor of DDS: it describes some types differently, so readers and writers would not match
_PORTS = 250  # of a domain, from 7400 on
_BUFFER = 2**22  # bytes of receive buffer requested for each port; the kernel may grant less
_OPEN = "other machines can reach the DDS ports too: this system cannot restrict them to loopback"
_BLOCKED = 10_000_000  # ns that a write may wait for slow readers
_ids = count(0x10000)  # of domains inside this process: each node has its own


def ros_name(name: str) -> str:
    """Return the absolute name of a topic of ROS: "wrench" -> "/wrench"."""
    return f"/{name.lstrip('/')}"


def _cyclone() -> SimpleNamespace:
    """Return the public names of cyclonedds as one namespace, or raise InputError."""
    with importing_extra("ROS 2 needs cyclonedds", "live"):
        import_module("cyclonedds")
    found: dict[str, Any] = {}
    for name in ("core", "domain", "topic", "sub", "pub", "qos", "builtin"):
        found |= vars(import_module(f"cyclonedds.{name}"))
    return SimpleNamespace(**{name: value for name, value in found.items() if not name.startswith("_")})


class DdsNode:
    """A participant in a domain, configured without files and environment variables.

    Args:
        domain: number of the domain, as ROS_DOMAIN_ID.
        interface: name or address of the network interface; "": loopback only, without multicast.

    Attributes:
        where: words for the domain in errors.
    """

    def __init__(self, domain: int = 0, interface: str = "") -> None:
        self.domain, self.interface = domain, interface
        self.where = f"ROS 2, domain {domain}"
        self._ends: list[_End] = []
        self._dds: Any = None
        self._own: Any = None  # the domain inside this process
        self._participant: Any = None
        self._seen: Any = None

    def open(self) -> str:
        """Join the domain.

        Returns:
            A sentence if other machines can reach the node's ports although `interface` is ""; else "".

        Raises:
            InputError: cyclonedds is not installed, the interface does not exist, or too many participants are on it.
        """
        dds = _cyclone()
        _check_interface(self.interface)
        own, before = next(_ids), _sockets()
        try:
            self._own = dds.Domain(own, _configuration(self.domain, self.interface))
            self._participant = dds.DomainParticipant(own)
        except dds.DDSException as problem:
            self.close()
            hint = f"Check that the interface has an address, and at most {_PARTICIPANTS} programs run here."
            what = f"the domain cannot be joined ({problem.msg})."
            raise InputError(what, where=self.where, hint=hint) from problem
        self._dds = dds
        self._seen = dds.BuiltinDataReader(self._participant, dds.BuiltinTopicDcpsPublication)
        return "" if self.interface else _keep_to_loopback(self.domain, before)

    def close(self) -> None:
        """Leave the domain and end its readers and writers; may be called again."""
        for end in self._ends:
            end.entity = end.waiting = None
        self._ends = []
        self._seen = self._participant = self._own = None

    def reader(
        self, topic: str, kind: str, *, reliable: bool = False, latched: bool = False, depth: int = DEPTH
    ) -> DdsReader:
        """Return a `DdsReader` of one topic; the node must be open.

        Args:
            topic: name as in ROS.
            kind: type of the messages.
            reliable: request lost messages again; else they are only counted.
            latched: also request messages published before (/tf_static).
            depth: most messages that wait; beyond it the newest are lost, or with `reliable` or `latched` the oldest.

        Raises:
            InputError: the topic's name is not valid in ROS, or the type is unknown.
        """
        policy, kept = self._dds.Policy, self._dds.Policy.Durability
        quality = (
            [policy.Reliability.Reliable(_BLOCKED), policy.History.KeepLast(depth)]
            if reliable or latched
            else [policy.Reliability.BestEffort, policy.History.KeepAll, policy.ResourceLimits(depth, -1, -1)]
        )
        quality.append(kept.TransientLocal if latched else kept.Volatile)
        entity = self._dds.DataReader(self._participant, self._topic(topic, kind), qos=self._dds.Qos(*quality))
        made = DdsReader(entity, self._dds, Topic(ros_name(topic), kind, "cdr"))
        self._ends.append(made)
        return made

    def writer(self, topic: str, kind: str, *, latched: bool = False, depth: int = 100) -> Writer:
        """Return a reliable `Writer` to one topic of the open node.

        Args:
            topic: name as in ROS.
            kind: type of the messages.
            latched: keep the last `depth` messages for later readers.
            depth: most messages that wait for slow readers.

        Raises:
            InputError: the topic's name is not valid in ROS, or the type is unknown.
        """
        policy, kept = self._dds.Policy, self._dds.Policy.Durability
        quality = [policy.Reliability.Reliable(_BLOCKED), policy.History.KeepLast(depth)]
        if latched:
            quality += [kept.TransientLocal, policy.DurabilityService(0, policy.History.KeepLast(depth), -1, -1, -1)]
        entity = self._dds.DataWriter(self._participant, self._topic(topic, kind), qos=self._dds.Qos(*quality))
        made = Writer(entity, self._dds, idl_type(kind))
        self._ends.append(made)
        return made

    def topics(self) -> list[Topic]:
        """Return the topics of ROS published now, sorted by name; `count` is the number of publishers."""
        state = self._dds
        alive = state.SampleState.Any | state.ViewState.Any | state.InstanceState.Alive
        condition = state.ReadCondition(self._seen, alive)
        found: dict[tuple[str, str], int] = {}
        for each in self._seen.read(10_000, condition=condition):
            if each.topic_name and each.topic_name.startswith("rt/"):
                key = (each.topic_name[2:], ros_type_name(each.type_name))
                found[key] = found.get(key, 0) + 1
        return [Topic(*key, "cdr", publishers) for key, publishers in sorted(found.items())]

    def settled(self, patience: float, names: Sequence[str] = ()) -> list[Topic]:
        """Return `topics()` after `patience` [s], or as soon as all `names`, if any, are among them."""
        deadline = time.monotonic() + patience
        while True:
            there = self.topics()
            known = {topic.name for topic in there}
            if (names and known.issuperset(names)) or time.monotonic() >= deadline:
                return there
            time.sleep(0.01)  # announcements come a few times a second

    def _topic(self, name: str, kind: str) -> Any:
        if not re.fullmatch(r"(/[A-Za-z_][A-Za-z0-9_]*)+", ros_name(name)):
            hint = "Use letters, digits and _, in parts separated by / that do not begin with a digit."
            raise InputError(f"{name!r} cannot be the name of a ROS topic.", where=self.where, hint=hint)
        return self._dds.Topic(self._participant, f"rt{ros_name(name)}", idl_type(kind))


class _End:
    """A reader or a writer of an open node."""

    def __init__(self, entity: Any, dds: Any) -> None:
        self.entity, self.waiting, self._dds = entity, None, dds


class DdsReader(_End):
    """A reader of messages, as bytes, of one topic.

    Attributes:
        topic: name and type of the topic.
    """

    def __init__(self, entity: Any, dds: Any, topic: Topic) -> None:
        super().__init__(entity, dds)
        self.topic = topic
        self.waiting: Any = dds.WaitSet(entity.participant)
        everything = dds.SampleState.Any | dds.ViewState.Any | dds.InstanceState.Any
        self.waiting.attach(dds.ReadCondition(entity, everything))
        self._lost = 0

    def wait(self, timeout: float) -> bool:
        """Return whether a message waits; wait up to `timeout` [s] for one."""
        return self.waiting.wait(round(max(timeout, 0.0) * 1e9)) > 0

    def take(self, limit: int = DEPTH) -> MessageBlock:
        """Return up to `limit` waiting messages: a `MessageBlock` of bytes (CDR) and times [ns] of sending."""
        samples = [sample for sample in self.entity.take(limit) if sample.sample_info.valid_data]
        length = np.array([len(sample.data) for sample in samples], dtype=np.int64)
        sent = np.array([sample.sample_info.source_timestamp for sample in samples], dtype=np.int64)
        start = np.cumsum(length) - length
        data = b"".join([sample.data for sample in samples])
        return MessageBlock(data, {0: self.topic}, np.zeros(len(samples), dtype=np.int64), sent, start, length)

    def lost(self) -> int:
        """Return the number of messages since the last call that were lost, or had no room."""
        total = self.entity.get_sample_lost_status().total_count + self.entity.get_sample_rejected_status().total_count
        self._lost, before = total, self._lost
        return total - before

    @property
    def publishers(self) -> int:
        """Number of publishers that the reader hears now."""
        return self.entity.get_subscription_matched_status().current_count


class Writer(_End):
    """A writer of messages, as bytes, to one topic."""

    def __init__(self, entity: Any, dds: Any, made: Any) -> None:
        super().__init__(entity, dds)
        self._made = made

    def write(self, data: bytes) -> bool:
        """Send one message, and return True; False if slow readers did not take it within 10 ms.

        Raises:
            DDSException: cyclonedds cannot send it for another reason.
        """
        try:
            self.entity.write(self._made(data))
        except self._dds.DDSException as problem:
            if problem.code != self._dds.DDSException.DDS_RETCODE_TIMEOUT:
                raise
            return False
        return True

    @property
    def readers(self) -> int:
        """Number of readers that listen to the topic now."""
        return len(self.entity.get_matched_subscriptions())


def _configuration(domain: int, interface: str) -> str:
    local = not interface
    key = "address" if local or _is_address(interface) else "name"
    peers = f'<Peers><Peer address="{LOOPBACK}"/></Peers>' if local else ""
    return f"""<CycloneDDS><Domain Id="any">
<General><Interfaces><NetworkInterface {key}="{interface or LOOPBACK}"/></Interfaces>
<AllowMulticast>{"false" if local else "default"}</AllowMulticast></General>
<Discovery><ExternalDomainId>{domain}</ExternalDomainId><ParticipantIndex>auto</ParticipantIndex>
<MaxAutoParticipantIndex>{_PARTICIPANTS}</MaxAutoParticipantIndex>{peers}</Discovery>
<Compatibility><IgnoreTypeInformation>{_FAST_DDS}</IgnoreTypeInformation></Compatibility>
<Internal><SocketReceiveBufferSize max="{_BUFFER}B"/></Internal>
</Domain></CycloneDDS>"""


def _is_address(text: str) -> bool:
    return text.count(".") == 3 and text.replace(".", "").isdigit()


def _check_interface(interface: str) -> None:
    """Raise InputError unless this machine has the interface, by name or address, or it is ""."""
    names = [name for _, name in socket.if_nameindex()]
    if not interface or interface in names:
        return
    if _is_address(interface):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            if probe.connect_ex((interface, 9)) == 0 and probe.getsockname()[0] == interface:
                return
    hint = f"Write one of {', '.join(names)}, or its address; leave it out to stay on this machine."
    raise InputError(f"there is no network interface {interface!r}.", where="source.interface", hint=hint)


def _sockets() -> dict[str, int]:
    """Return the sockets of this process, name -> file descriptor; {} without /proc."""
    folder, found = Path("/proc/self/fd"), dict[str, int]()
    for name in os.listdir(folder) if folder.is_dir() else ():
        with suppress(FileNotFoundError):  # that of the folder itself
            found[os.readlink(folder / name)] = int(name)
    return {name: handle for name, handle in found.items() if name.startswith("socket:")}


def _keep_to_loopback(domain: int, before: Collection[str]) -> str:
    """Close a domain's sockets, but for those `before`, to other machines; return a sentence if that fails, else ""."""
    option = getattr(socket, "SO_BINDTODEVICE", None)
    names = [name for _, name in socket.if_nameindex() if name.startswith("lo")]
    if option is None or not names:
        return _OPEN
    for own in _receiving(domain, before):
        with own:
            try:
                own.setsockopt(socket.SOL_SOCKET, option, names[0].encode())
            except PermissionError:  # Linux before 5.7
                return _OPEN
    return ""


def _receiving(domain: int, before: Collection[str]) -> Iterator[socket.socket]:
    """Yield a second handle of each socket of a domain that is not in `before`."""
    first = 7400 + _PORTS * domain
    for name, handle in _sockets().items():
        if name in before:
            continue
        own = socket.socket(fileno=os.dup(handle))
        address = own.getsockname() if own.family == socket.AF_INET else ("", 0)
        if own.type == socket.SOCK_DGRAM and first <= address[1] < first + _PORTS:
            yield own
        else:
            own.close()
