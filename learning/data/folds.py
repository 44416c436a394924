"""Split of rooms into training rooms and a held-out room."""

from __future__ import annotations

from collections.abc import Sequence

from starling.patterns import errors


def training_rooms(rooms: Sequence[str], held: str, count: int | None = None) -> tuple[str, ...]:
    """Return the training rooms of a held-out room: the next ones in cyclic order.

    Args:
        rooms: all rooms in an arbitrary order.
        held: the held-out room.
        count: number of training rooms; None takes all others.

    Raises:
        InputError: if the room is unknown, or there are too few other rooms.
    """
    errors.one_of("held-out room", held, rooms)
    number = list(rooms).index(held)
    remaining = (*rooms[number + 1 :], *rooms[:number])
    if not remaining:
        raise errors.refuse("rooms", "must be at least 2", 1, "Take captures of more rooms.")
    wanted = len(remaining) if count is None else count
    errors.in_interval("rooms to learn from", wanted, 1, len(remaining))
    return remaining[:wanted]
