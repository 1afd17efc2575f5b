//! Closed forms that a free curve may be, each up to what offset and gain absorb.

use std::f64::consts::{PI, TAU};

use crate::terms::term::Over;

/// What an entry of a shape measures, and so its unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Measures {
    /// A place: a reading, or a time.
    Place,
    /// A length along the curve: readings, or time.
    Extent,
    /// Waves in one turn of the joint.
    PerTurn,
    /// A part of one period.
    Phase,
}

/// Joints that a form belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Joints {
    Any,
    Turning,
    Sliding,
}

/// A closed form: its columns at `x`, for a shape that is searched for.
pub(crate) struct Form {
    /// Its name.
    pub name: &'static str,
    /// What the curve does, as the end of a sentence that begins with the curve.
    pub words: &'static str,
    pub over: Over,
    pub joints: Joints,
    /// Names of the entries of the shape.
    pub shape: &'static [(&'static str, Measures)],
    /// Names of the amplitudes, one for each column.
    pub amplitudes: &'static [&'static str],
    /// Values to try of each entry, by the lowest and the highest `x`.
    pub grid: fn(f64, f64) -> Vec<Vec<f64>>,
    /// The columns at `x`.
    pub columns: fn(f64, &[f64], &mut [f64]),
}

/// Most columns of a form.
pub(crate) const WIDEST: usize = 2;

/// Every form. `x` is the coordinate of the joint from the middle of its range (rad, or length), or
/// time from 0 to 1.
pub(crate) const FORMS: [Form; 13] = [
    Form {
        name: "parabola",
        words: "is a parabola",
        over: Over::Reading,
        joints: Joints::Any,
        shape: &[],
        amplitudes: &["c2"],
        grid: |_, _| Vec::new(),
        columns: |x, _, out| out[0] = x * x,
    },
    Form {
        name: "cubic",
        words: "is a cubic",
        over: Over::Reading,
        joints: Joints::Any,
        shape: &[],
        amplitudes: &["c2", "c3"],
        grid: |_, _| Vec::new(),
        columns: |x, _, out| (out[0], out[1]) = (x * x, x * x * x),
    },
    Form {
        name: "n_per_turn",
        words: "is periodic in the angle",
        over: Over::Reading,
        joints: Joints::Turning,
        shape: &[("n", Measures::PerTurn)],
        amplitudes: &["s", "c"],
        grid: |low, high| vec![waves().map(|k| k * TAU / (high - low)).collect()],
        columns: |x, shape, out| (out[0], out[1]) = (shape[0] * x).sin_cos(),
    },
    Form {
        name: "periodic",
        words: "is periodic in the way",
        over: Over::Reading,
        joints: Joints::Sliding,
        shape: &[("period", Measures::Extent)],
        amplitudes: &["s", "c"],
        grid: |low, high| vec![waves().map(|k| (high - low) / k).collect()],
        columns: |x, shape, out| (out[0], out[1]) = (TAU * x / shape[0]).sin_cos(),
    },
    Form {
        name: "kink",
        words: "bends at one reading",
        over: Over::Reading,
        joints: Joints::Any,
        shape: &[("at", Measures::Place)],
        amplitudes: &["slope"],
        grid: |low, high| vec![inside(low, high, 63)],
        columns: |x, shape, out| out[0] = (x - shape[0]).max(0.0),
    },
    Form {
        name: "step",
        words: "steps at one reading",
        over: Over::Reading,
        joints: Joints::Any,
        shape: &[("at", Measures::Place)],
        amplitudes: &["step"],
        grid: |low, high| vec![inside(low, high, 127)],
        columns: |x, shape, out| out[0] = f64::from(u8::from(x >= shape[0])),
    },
    Form {
        name: "dead_band",
        words: "stands still between two readings",
        over: Over::Reading,
        joints: Joints::Any,
        shape: &[("from", Measures::Place), ("width", Measures::Extent)],
        amplitudes: &["slope"],
        grid: |low, high| vec![inside(low, high, 31), growing(high - low, 0.02, 0.5, 1.3)],
        columns: |x, shape, out| out[0] = (x - shape[0]).clamp(0.0, shape[1]),
    },
    Form {
        name: "saturation",
        words: "bends towards both ends of the range",
        over: Over::Reading,
        joints: Joints::Any,
        shape: &[("from", Measures::Place), ("to", Measures::Place)],
        amplitudes: &["low", "high"],
        grid: |low, high| {
            let middle = 0.5 * (low + high);
            vec![inside(low, middle, 15), inside(middle, high, 15)]
        },
        columns: |x, shape, out| {
            (out[0], out[1]) = ((shape[0] - x).max(0.0), (x - shape[1]).max(0.0));
        },
    },
    Form {
        name: "coarse_code",
        words: "is the saw of a coarse code",
        over: Over::Reading,
        joints: Joints::Any,
        shape: &[("step", Measures::Extent), ("phase", Measures::Phase)],
        amplitudes: &["height"],
        grid: |low, high| {
            let phases = (0..16).map(|k| f64::from(k) / 16.0).collect();
            vec![growing(high - low, 0.02, 0.34, 1.01), phases]
        },
        columns: |x, shape, out| {
            let place = x / shape[0] + shape[1];
            out[0] = place - place.floor() - 0.5;
        },
    },
    Form {
        name: "line",
        words: "is a line over time",
        over: Over::Time,
        joints: Joints::Any,
        shape: &[],
        amplitudes: &["rate"],
        grid: |_, _| Vec::new(),
        columns: |t, _, out| out[0] = t,
    },
    Form {
        name: "warm_up",
        words: "approaches its end exponentially",
        over: Over::Time,
        joints: Joints::Any,
        shape: &[("time_constant", Measures::Extent)],
        amplitudes: &["change"],
        grid: |_, _| vec![growing(1.0, 0.01, 2.0, 1.1)],
        columns: |t, shape, out| out[0] = -(-t / shape[0]).exp_m1(),
    },
    Form {
        name: "step",
        words: "steps at one time",
        over: Over::Time,
        joints: Joints::Any,
        shape: &[("at", Measures::Place)],
        amplitudes: &["step"],
        grid: |low, high| vec![inside(low, high, 127)],
        columns: |t, shape, out| out[0] = f64::from(u8::from(t >= shape[0])),
    },
    Form {
        name: "wave",
        words: "is periodic in time",
        over: Over::Time,
        joints: Joints::Any,
        shape: &[("period", Measures::Extent)],
        amplitudes: &["s", "c"],
        grid: |_, _| vec![waves().map(f64::recip).collect()],
        columns: |t, shape, out| (out[0], out[1]) = (TAU * t / shape[0]).sin_cos(),
    },
];

/// Columns that any smooth curve is made of: `cos(k π s)` of `s` from 0 to 1.
pub(crate) fn any(s: f64, out: &mut [f64]) {
    for (k, out) in out.iter_mut().enumerate() {
        *out = ((k + 1) as f64 * PI * s).cos();
    }
}

/// Numbers of waves over a span: from a third of one to twenty, in steps that neighbours resolve.
fn waves() -> impl Iterator<Item = f64> {
    (0..132).map(|k| 0.33 + 0.15 * f64::from(k))
}

/// So many values between two, evenly.
fn inside(low: f64, high: f64, count: usize) -> Vec<f64> {
    let step = (high - low) / (count + 1) as f64;
    (1..=count).map(|k| low + step * k as f64).collect()
}

/// Values between two parts of a width, in steps of a factor.
fn growing(width: f64, from: f64, to: f64, factor: f64) -> Vec<f64> {
    let within = |v: &f64| *v <= to * width;
    std::iter::successors(Some(from * width), |v| Some(v * factor)).take_while(within).collect()
}
