"""A bag of any kind behind one face: its topics, the index of each, and single messages, decoded."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from stereocalib_core.config.reading import MOST_BYTES_OF_A_CALIBRATION, MOST_BYTES_UNPACKED_FOR_TIMES
from stereocalib_core.errors import SourceError
from stereocalib_core.sources.bags import messages
from stereocalib_core.sources.bags.storages import (
    Entry,
    McapStorage,
    Ros1Storage,
    SqliteStorage,
    Storage,
    cdr_stamp,
    ros1_stamp,
)

NO_ROSBAGS = "install it: pip install 'stereocalib[bags]'"


class Bag:
    """An open bag. types: topic to message type; counts: topic to number of messages; files: what it is made of."""

    def __init__(self, path: Path) -> None:
        """Raises SourceError in one line for what is no bag, damaged, or without `rosbags`."""
        try:
            from rosbags.highlevel import AnyReader
            from rosbags.typesys import Stores, get_typestore
        except ImportError as error:
            raise SourceError("bags need the package rosbags", path, NO_ROSBAGS) from error
        self._path = path
        self.files = _files(path)
        store = get_typestore(Stores.ROS2_HUMBLE)
        try:
            self._reader: Any = AnyReader(
                self.files if path.is_file() or _ros1(path) else [path], default_typestore=store
            )
            self._reader.open()
            self._storages: list[Storage] = self._open_storages()
            self.types = {str(c.topic): str(c.msgtype) for c in self._reader.connections}
            self.counts: dict[str, int] = {}
            for connection in self._reader.connections:
                self.counts[connection.topic] = self.counts.get(connection.topic, 0) + int(
                    connection.msgcount
                )
        except SourceError:
            raise
        except Exception as error:  # noqa: BLE001 - rosbags lets through whatever a damaged file makes it stumble on
            raise SourceError("bag cannot be read", path, _short(error)) from error
        self._entries: dict[str, list[tuple[Storage, Entry]]] = {}
        self._home: dict[int, Storage] = {}

    def _open_storages(self) -> list[Storage]:
        storages: list[Storage] = []
        for reader in self._reader.readers:
            if not self._reader.is2:
                storages.append(Ros1Storage(reader))
                continue
            packed = reader.compression_mode == "message"
            for inner in getattr(reader.storage, "storages", [reader.storage]):
                path = Path(inner.path)
                if path.suffix == ".mcap":
                    channels = {c.id: c.topic for c in inner.connections}
                    storages.append(McapStorage(path, channels, packed))
                else:
                    storages.append(SqliteStorage(path, packed))
        return storages

    def entries(self, topic: str) -> list[Entry]:
        """The messages of a topic in the order of their recording; raises SourceError for a damaged index."""
        if topic not in self._entries:
            try:
                found = [(storage, entry) for storage in self._storages for entry in storage.entries(topic)]
            except SourceError:
                raise
            except Exception as error:  # noqa: BLE001 - as above
                raise SourceError("index of the bag is damaged", self._path, _short(error)) from error
            if (
                any(entry.header_ns is None for _, entry in found)
                and self._small
                and not self._stampless(topic)
            ):
                found = [(storage, self._stamped(storage, entry)) for storage, entry in found]
            found.sort(key=lambda pair: pair[1].log_ns)
            self._entries[topic] = found
            self._home.update({id(entry): storage for storage, entry in found})
        return [entry for _, entry in self._entries[topic]]

    @property
    def _small(self) -> bool:
        return sum(path.stat().st_size for path in self.files) <= MOST_BYTES_UNPACKED_FOR_TIMES

    def _stampless(self, topic: str) -> bool:
        return self.types[topic] in (messages.TF_STATIC,)

    def _stamped(self, storage: Storage, entry: Entry) -> Entry:
        """The entry with its header's stamp, for which its packed message is unpacked."""
        try:
            data = storage.raw(entry)
        except Exception:  # noqa: BLE001 - damaged: its frame will say so
            return entry
        stamp = cdr_stamp(data) if self._reader.is2 else ros1_stamp(data)
        return dataclasses.replace(entry, header_ns=stamp)

    def message(self, topic: str, entry: Entry) -> Any:
        """One message, decoded; raises SourceError where it is damaged."""
        try:
            return self._reader.deserialize(self._home[id(entry)].raw(entry), self.types[topic])
        except Exception as error:  # noqa: BLE001 - a damaged message makes decoders stumble in many ways
            raise SourceError("message cannot be read", f"{self._path}, {topic}", _short(error)) from error


def _ros1(path: Path) -> bool:
    return path.is_dir() and not (path / "metadata.yaml").is_file() and any(path.glob("*.bag"))


def _files(path: Path) -> list[Path]:
    """The files of a bag; raises SourceError where there are none."""
    if path.is_dir():
        found = [p for p in sorted(path.iterdir()) if p.suffix in (".bag", ".mcap", ".db3", ".zstd")]
        bags = [p for p in found if p.suffix == ".bag"]
        if bags and not (path / "metadata.yaml").is_file():
            return bags
        if not (path / "metadata.yaml").is_file():
            raise SourceError(
                "no bag in the folder", path, "a ROS 2 bag needs its metadata.yaml; or name its file"
            )
        if (path / "metadata.yaml").stat().st_size > MOST_BYTES_OF_A_CALIBRATION:
            raise SourceError(
                "metadata.yaml too large", path, f"at most {MOST_BYTES_OF_A_CALIBRATION >> 10} kB are read"
            )
        return [path / "metadata.yaml", *found]
    if not path.is_file():
        raise SourceError("no such bag", path, "check the path")
    return [path]


def _short(error: BaseException) -> str:
    return " ".join(str(error).split())[:160] or type(error).__name__
