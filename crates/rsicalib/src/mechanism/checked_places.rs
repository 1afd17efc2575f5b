//! Checks of where points, planes, lines and frames are.

use crate::Error;
use crate::mechanism::checks::{angles, finite, known, refuse};
use crate::mechanism::drawing::{Mechanism, Point};
use crate::text::{listed, quoted};

impl Mechanism {
    /// Checks the keys of a point that say where it is unknown or measured.
    pub(super) fn check_where(&self, point: &Point) -> Result<(), Error> {
        let place = || format!("point {}", quoted(&point.name));
        if let Some(keys) = point.unknown.as_ref().filter(|keys| point.moves() && keys.len() > 1) {
            let expected = "`pose` alone: every pose has a place of its own";
            return Err(refuse(place(), format!("unknown = [{}]", listed(keys)), expected.into()));
        }
        if let Some(free) = &point.free {
            let axes = ["x", "y", "z"];
            let strange = free.iter().find(|f| !axes.contains(&f.as_str()));
            let found = match strange {
                Some(name) => format!("free coordinate {}", quoted(name)),
                None if free.is_empty() => "no free coordinate".into(),
                None if !point.is_unknown() => "free coordinates of a known point".into(),
                None if point.at.is_none() && point.frees().contains(&false) => {
                    "no `at` for the coordinates that are not free".into()
                }
                None => String::new(),
            };
            if !found.is_empty() {
                let expected = "some of x, y and z of an unknown point, and `at` for the others";
                return Err(refuse(place(), found, expected.into()));
            }
        }
        match &point.frame {
            Some(frame) if point.columns.is_some() => known(self.frame_index(frame), place),
            Some(frame) => {
                known(self.frame_index(frame), place)?;
                let of = &self.frames[self.frame_index(frame)?];
                let here = point.unknown.is_none() && point.at.is_some() && point.chain.is_none();
                match here && (of.moves() || of.unknown.is_none()) {
                    true => Ok(()),
                    false => {
                        let expected = "`columns` of a point that is measured in a frame, or `at` of one \
                                        in a frame that is known or has `unknown = [\"pose\"]`";
                        Err(refuse(place(), format!("frame {}", quoted(frame)), expected.into()))
                    }
                }
            }
            None => Ok(()),
        }
    }

    /// Checks planes, lines and frames.
    pub(super) fn check_places(&self) -> Result<(), Error> {
        let direction = |what: String, direction: &[f64; 3]| {
            finite(direction.iter(), || what.clone())?;
            match direction.iter().any(|d| *d != 0.0) {
                true => Ok(()),
                false => Err(refuse(what, "[0, 0, 0]".into(), "a direction".into())),
            }
        };
        for plane in &self.planes {
            let place = || format!("plane {}", quoted(&plane.name));
            finite(plane.offset.iter(), place)?;
            if let Some(normal) = &plane.normal {
                direction(place(), normal)?;
            }
            if plane.unknown.is_none() && (plane.normal.is_none() || plane.offset.is_none()) {
                let expected = "`normal` and `offset`, or `unknown = [columns]`";
                return Err(refuse(place(), "no place".into(), expected.into()));
            }
        }
        for line in &self.lines {
            let place = || format!("line {}", quoted(&line.name));
            finite(line.at.iter().flatten(), place)?;
            if let Some(along) = &line.direction {
                direction(place(), along)?;
            }
            if line.unknown.is_none() && (line.at.is_none() || line.direction.is_none()) {
                let expected = "`at` and `direction`, or `unknown = [columns]`";
                return Err(refuse(place(), "no place".into(), expected.into()));
            }
        }
        for frame in &self.frames {
            let place = || format!("frame {}", quoted(&frame.name));
            finite(frame.pose.iter().flatten(), place)?;
            angles(frame.pose.iter().flat_map(|pose| &pose[3..]), place)?;
            if let Some(keys) =
                frame.unknown.as_ref().filter(|keys| frame.moves() && keys.len() > 1)
            {
                let expected = "`pose` alone: every pose has a place of its own";
                return Err(refuse(
                    place(),
                    format!("unknown = [{}]", listed(keys)),
                    expected.into(),
                ));
            }
            let seen = |p: &&Point| p.frame.as_ref() == Some(&frame.name) && p.columns.is_some();
            if let Some(point) = self.points.iter().find(seen).filter(|_| frame.moves()) {
                let expected = "`at` of a point in a frame that is somewhere else in each pose";
                let found = format!("`columns` of point {}", quoted(&point.name));
                return Err(refuse(place(), found, expected.into()));
            }
            if frame.pose.is_none() && frame.unknown.is_none() {
                let expected = "`pose = [x, y, z, rx, ry, rz]`, or `unknown = [columns]`";
                return Err(refuse(place(), "no place".into(), expected.into()));
            }
        }
        Ok(())
    }
}
