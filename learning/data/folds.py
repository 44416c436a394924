"""How rooms are split into those learnt from and the one that is judged."""

from __future__ import annotations

from collections.abc import Sequence

from starling.patterns import errors


def learnt_from(rooms: Sequence[str], held: str, count: int | None = None) -> tuple[str, ...]:
    """Rooms to learn from while one is held out: the next ones in order, round and round.

    Args:
        rooms: all, in an order that says nothing.
        held: the one held out.
        count: how many; None takes all others.

    Raises:
        InputError: if the room is none of them, or there are not that many others, or none.
    """
    errors.one_of("held-out room", held, rooms)
    number = list(rooms).index(held)
    others = (*rooms[number + 1 :], *rooms[:number])
    if not others:
        raise errors.refuse("rooms", "must be at least 2", 1, "Take captures of more rooms.")
    wanted = len(others) if count is None else count
    errors.in_interval("rooms to learn from", wanted, 1, len(others))
    return others[:wanted]
