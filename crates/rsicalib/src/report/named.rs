//! Names and what each has.

/// Names and what each has, in the order of the mechanism.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Named<T = f64>(pub Vec<(String, T)>);

impl<T> Named<T> {
    /// True where nothing is named.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

#[cfg(feature = "serde")]
impl<T: serde::Serialize> serde::Serialize for Named<T> {
    fn serialize<S: serde::Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.collect_map(self.0.iter().map(|(k, v)| (k, v)))
    }
}

#[cfg(feature = "serde")]
impl<'de, T: serde::Deserialize<'de>> serde::Deserialize<'de> for Named<T> {
    fn deserialize<D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        from.deserialize_map(Entries(std::marker::PhantomData))
    }
}

/// Reads the entries of an object in their order.
#[cfg(feature = "serde")]
struct Entries<T>(std::marker::PhantomData<T>);

#[cfg(feature = "serde")]
impl<'de, T: serde::Deserialize<'de>> serde::de::Visitor<'de> for Entries<T> {
    type Value = Named<T>;

    fn expecting(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        to.write_str("a map")
    }

    fn visit_map<A: serde::de::MapAccess<'de>>(self, mut map: A) -> Result<Named<T>, A::Error> {
        let mut all = Vec::new();
        while let Some(entry) = map.next_entry()? {
            all.push(entry);
        }
        Ok(Named(all))
    }
}

#[cfg(feature = "document")]
impl<T: schemars::JsonSchema> schemars::JsonSchema for Named<T> {
    fn inline_schema() -> bool {
        true
    }

    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Named".into()
    }

    fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
        <indexmap::IndexMap<String, T>>::json_schema(generator)
    }
}
