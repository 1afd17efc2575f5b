//! Arrays of a mechanism that have as many entries as they need, and no more.
//!
//! The array of serde reads what it needs; whether more follows, TOML and Python do not ask.

use std::collections::BTreeMap;
use std::fmt;
use std::marker::PhantomData;

use serde::de::{Deserialize, Deserializer, Error, IgnoredAny, SeqAccess, Visitor};

/// An array; more entries than it has are refused.
pub(super) fn array<'de, D, T, const N: usize>(from: D) -> Result<[T; N], D::Error>
where
    D: Deserializer<'de>,
    T: Deserialize<'de>,
{
    Exactly::deserialize(from).map(|Exactly(array)| array)
}

/// The same of an array that may be left out.
pub(super) fn optional<'de, D, T, const N: usize>(from: D) -> Result<Option<[T; N]>, D::Error>
where
    D: Deserializer<'de>,
    T: Deserialize<'de>,
{
    Ok(Option::deserialize(from)?.map(|Exactly(array)| array))
}

/// The same of an array under each name.
pub(super) fn named<'de, D, T, const N: usize>(
    from: D,
) -> Result<BTreeMap<String, [T; N]>, D::Error>
where
    D: Deserializer<'de>,
    T: Deserialize<'de>,
{
    let named: BTreeMap<String, Exactly<T, N>> = BTreeMap::deserialize(from)?;
    Ok(named.into_iter().map(|(name, Exactly(array))| (name, array)).collect())
}

struct Exactly<T, const N: usize>([T; N]);

impl<'de, T: Deserialize<'de>, const N: usize> Deserialize<'de> for Exactly<T, N> {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        from.deserialize_seq(Entries(PhantomData)).map(Self)
    }
}

struct Entries<T, const N: usize>(PhantomData<T>);

impl<'de, T: Deserialize<'de>, const N: usize> Visitor<'de> for Entries<T, N> {
    type Value = [T; N];

    fn expecting(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "an array of length {N}")
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut entries: A) -> Result<[T; N], A::Error> {
        let mut taken = Vec::with_capacity(N);
        while taken.len() < N
            && let Some(entry) = entries.next_element()?
        {
            taken.push(entry);
        }
        let mut found = taken.len();
        while found >= N && entries.next_element::<IgnoredAny>()?.is_some() {
            found += 1;
        }
        match <[T; N]>::try_from(taken) {
            Ok(array) if found == N => Ok(array),
            _ => Err(A::Error::invalid_length(found, &self)),
        }
    }
}
