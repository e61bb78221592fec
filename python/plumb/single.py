"""Objects whose state is in the native half, so that a copy would be the same object again."""

from __future__ import annotations

from typing import NoReturn

from ._plumb import Error


class Single:
    """What can be neither copied nor pickled."""

    def __reduce_ex__(self, _protocol: object) -> NoReturn:
        kind = type(self).__name__
        raise Error(f"a {kind} can't be copied or pickled: make another {kind}")
