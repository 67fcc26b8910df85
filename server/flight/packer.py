"""Inputs of a tick as bytes, quickly: what is the same object as a tick ago is not packed anew."""

from collections.abc import Mapping
from typing import Any

from ..control.state import Inputs, Settings
from .values import Packer, fields_of, struct_head


class _Fields:
    """Packs values of one class field by field, and keeps what the last one's fields packed to."""

    def __init__(self, kind: type, packer: Packer) -> None:
        self._pack = packer.pack
        self._get, count = fields_of(kind)
        self._head = struct_head(kind)
        self._last: list[Any] = [self] * count
        self._packed = [b""] * count

    def pack(self, value: object) -> bytes:
        """Return the same bytes as `values.pack`."""
        last, packed = self._last, self._packed
        for i, field in enumerate(self._get(value)):
            if field is not last[i]:
                packed[i] = self._field(field, last[i], packed[i])
                last[i] = field
        return self._head + b"".join(packed)

    def _field(self, field: Any, _before: Any, _bytes: bytes) -> bytes:
        return self._pack(field)


class _SettingsFields(_Fields):
    """Settings are made anew in every tick, mostly of the same objects."""

    def _field(self, field: Any, before: Any, known: bytes) -> bytes:
        if isinstance(field, dict) and isinstance(before, dict) and _same(field, before):
            return known
        return self._pack(field)


class InputsPacker(_Fields):
    """Packs the inputs of one arm, tick after tick."""

    def __init__(self) -> None:
        packer = Packer()
        super().__init__(Inputs, packer)
        self._settings = _SettingsFields(Settings, packer)

    def _field(self, field: Any, _before: Any, _bytes: bytes) -> bytes:
        if type(field) is Settings:
            return self._settings.pack(field)
        return self._pack(field)


def _same(a: Mapping[str, Any], b: Mapping[str, Any]) -> bool:
    """Return whether two mappings hold the same objects under the same keys, in one order."""
    return len(a) == len(b) and all(
        ka == kb and va is vb for (ka, va), (kb, vb) in zip(a.items(), b.items(), strict=True)
    )
