//! One level for what is called significant, and that of intervals.

/// Share of clean sessions that are called otherwise than adequate, search and judgement together.
pub const CLEAN: f64 = 0.01;

/// What is less probable than this by chance is significant: the residual, the error on poses left
/// out in turn, and that on known poses. A session is looked at three times, by the search and the
/// first two, and each look has its share of [`CLEAN`]; known poses have as much beside them.
pub const LEVEL: f64 = CLEAN / 3.0;

/// What an interval of 95 % leaves out.
pub(crate) const ONE_IN_TWENTY: f64 = 0.05;

/// Normal quantile of an interval of 95 %.
pub(crate) const NORMAL_95: f64 = 1.959_963_984_540_054;
