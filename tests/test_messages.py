"""Messages of the core show no values of Rust."""

from __future__ import annotations

import pytest

import rsicalib
from rsicalib.errors import InputError
from scripts import messages


def test_the_core_makes_no_message_of_a_value_as_rust_writes_it() -> None:
    assert messages.main() == 0


@pytest.mark.parametrize(
    ("line", "is_wrong"),
    [
        ('let found = format!("{:?}", closure.value);', True),
        ('format!("ratio {ratio:?}")', True),
        ('format!("{:#?}", all)', True),
        ('assert!(ok, "{all:?}");', False),
        ("/// Not with `{:?}`.", False),
        ('format!("{:.3}", value)', False),
        ('#[cfg(test)]\nmod tests { format!("{:?}", 1) }', False),
    ],
)
def test_what_is_a_message(line: str, is_wrong: bool) -> None:
    assert bool(list(messages.wrong(line))) == is_wrong


@pytest.mark.parametrize("value", [-1.0, 0.0, float("inf")])
def test_a_distance_that_cannot_be_is_a_number_in_its_message(value: float) -> None:
    document = rsicalib.load_mechanism("rsi").to_dict()
    document["closure"][0]["value"] = value
    with pytest.raises(InputError) as error:
        rsicalib.Mechanism.from_dict(document)
    assert "Some" not in str(error.value) and "Known" not in str(error.value)
