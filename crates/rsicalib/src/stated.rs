//! Constants that somebody has stated and nobody has derived.
//!
//! `python -m tests.constants` measures what other values would do, in a build of its own with `--cfg stated`. There
//! the environment says them: `RSICALIB_STATED` is `name=value`, or several with commas. Any other build has them as they stand.

/// Declares such constants, as functions.
macro_rules! stated {
    ($($(#[$doc:meta])* $vis:vis fn $name:ident() -> $type:ty = $value:literal;)*) => {$(
        $(#[$doc])*
        #[cfg(not(stated))]
        $vis const fn $name() -> $type {
            $value
        }

        $(#[$doc])*
        #[cfg(stated)]
        $vis fn $name() -> $type {
            static VALUE: std::sync::LazyLock<$type> =
                std::sync::LazyLock::new(|| $crate::stated::instead(stringify!($name), $value));
            *VALUE
        }
    )*};
}

/// The value that the environment has for a constant, else its own.
///
/// # Panics
///
/// Where that is no value of its type: to measure nothing would look like a constant that changes nothing.
#[cfg(stated)]
pub(crate) fn instead<T: std::str::FromStr<Err: std::fmt::Debug>>(name: &str, own: T) -> T {
    let said = std::env::var("RSICALIB_STATED").unwrap_or_default();
    let mut others = said.split(',').filter_map(|one| one.split_once('='));
    others.find(|(of, _)| *of == name).map_or(own, |(_, value)| value.parse().expect(name))
}
