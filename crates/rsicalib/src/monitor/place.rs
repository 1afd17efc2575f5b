//! Places that may have another size in every row.

/// A place that may be unsteady: a channel, or the end of a chain.
#[derive(Debug, Clone)]
pub(crate) struct Place {
    pub(crate) term: &'static str,
    pub(crate) target: String,
    /// The channel, if it is one.
    pub(crate) channel: Option<usize>,
    /// The candidate whose columns move it, and how many of these.
    pub(crate) candidate: usize,
    pub(crate) columns: usize,
    pub(crate) unit: String,
}
