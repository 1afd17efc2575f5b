//! What is unknown: placements, known distances between unknown points, and starting positions.

use nalgebra::{Rotation3, Vector3};

use crate::closures::kind::Given;
use crate::kinematics::rigid::{rigid_fit, rigid_fit_near};
use crate::mechanism::Value;
use crate::model::compiled::{CompiledClosure, MeasuredLink, Model};
use crate::model::ends::{End, Measured};
use crate::model::numbering::{Owned, Unknown};
use crate::model::prior::Prior;
use crate::model::specification::Spec;
use crate::model::spheres::{Sphere, amid};
use crate::model::thing::Thing;
use crate::model::workspace::{Want, Workspace};
use crate::numerics::lanes::{Lanes, Vec3};
use crate::readings::{Block, Readings};

/// Pairs of points that tell where a frame is.
const ENOUGH: usize = 3;

/// What something unknown touches.
#[derive(Debug, Clone, Default)]
struct Touched {
    /// Places at which a point is.
    places: Vec<Vector3<f64>>,
    /// Points as a frame sees them, and where they are.
    pairs: Vec<(Vector3<f64>, Vector3<f64>)>,
    /// Spheres on which a point is.
    spheres: Vec<Sphere>,
}

impl Model {
    /// The parameter that a coordinate of an unknown thing is, by what results call both; none where
    /// these readings do not touch the thing, or where the axes of a plane or a line were chosen by others.
    pub(crate) fn column_called(&self, spec: &Spec, name: &str) -> Option<usize> {
        let own = |u: &&Unknown| {
            u.thing.term() == spec.term && spec.target.as_deref() == Some(u.name.as_str())
        };
        let unknown = self.unknowns.iter().find(own)?;
        if unknown.thing.faces_anywhere(&self.mechanism) {
            return None;
        }
        let mut coordinates = unknown.thing.coordinates(&self.mechanism).into_iter();
        let k = coordinates.position(|(coordinate, _)| coordinate == name)?;
        Some(self.term_parameters + unknown.first + k)
    }

    /// Number of the placement of every sample; `None` for a mechanism without unknown points.
    /// Unknown points that known distances link belong to one placement.
    #[must_use]
    pub fn placements(&self, readings: &Readings) -> Option<Vec<usize>> {
        let points = &self.owned.iter().find(|o| matches!(o.thing, Thing::Point(_)))?.numbers;
        let mut root: Vec<usize> = (0..self.unknowns.len()).collect();
        for link in self.links() {
            if let Prior::Apart { points: [a, b], .. } = link {
                let number = |c: usize| {
                    let first = c - self.term_parameters;
                    self.unknowns.iter().position(|u| u.first == first).unwrap_or_default()
                };
                let [a, b] = [a, b].map(|c| root[number(c)]);
                root.iter_mut().filter(|r| **r == b).for_each(|r| *r = a);
            }
        }
        let mut of_row = vec![0; readings.samples];
        for block in readings.blocks() {
            for &row in &block.rows[..block.live] {
                of_row[row] = root[points[block.group]];
            }
        }
        Some(of_row)
    }

    /// Known distances between unknown points of one group, as priors.
    #[must_use]
    pub fn links(&self) -> Vec<Prior> {
        self.links_of_closures().into_iter().map(|(_, link)| link).collect()
    }

    /// The same, each with its closure.
    pub(crate) fn links_of_closures(&self) -> Vec<(usize, Prior)> {
        let mut links = Vec::new();
        let closures = self.mechanism.closures.iter().enumerate();
        for (number, closure) in closures.filter(|(_, c)| self.mechanism.is_link(c)) {
            let ends = closure.between.each_ref().map(|end| self.mechanism.unknown_end(end));
            let [Some((a, fixed_a)), Some((b, fixed_b))] = ends else { continue };
            let of = |point: usize| {
                let own = self.unknowns.iter().enumerate();
                own.filter(move |(_, unknown)| unknown.thing == Thing::Point(point))
            };
            for (i, one) in of(a) {
                for (j, other) in of(b) {
                    let mine = self.free_keys(a, &one.keys, &fixed_a);
                    let theirs = self.free_keys(b, &other.keys, &fixed_b);
                    if i == j || mine.is_none() || mine != theirs {
                        continue;
                    }
                    let Some(value) = self.link_length(number, [i, j]) else { continue };
                    let sd = closure.sd.or(closure.noise).unwrap_or(1e-3 * value);
                    let points = [one, other].map(|u| self.term_parameters + u.first);
                    links.push((number, Prior::Apart { points, value, sd }));
                }
            }
        }
        links
    }

    /// The known distance between two unknown points: a number, or the mean of a column in the samples that touch
    /// either.
    fn link_length(&self, closure: usize, points: [usize; 2]) -> Option<f64> {
        match self.mechanism.closures[closure].value.as_ref()? {
            Value::Known(value) => Some(*value),
            Value::Column(_) => {
                let own = self.measured_links.iter().filter(|link| link.closure == closure);
                let here = own.filter(|link| points.contains(&link.point));
                let (sum, count) = here
                    .fold((0.0, 0.0), |(sum, count), link| (sum + link.sum, count + link.count));
                (count > 0.0).then(|| sum / count)
            }
        }
    }

    /// What columns say of distances between unknown points, closure by closure and point by point.
    pub(super) fn measure_links(&mut self, readings: &Readings) {
        let mechanism = &self.mechanism;
        let columns = mechanism.value_columns();
        let mut all = Vec::new();
        for (closure, drawn) in mechanism.closures.iter().enumerate() {
            let (true, Some(Value::Column(name))) = (mechanism.is_link(drawn), &drawn.value) else {
                continue;
            };
            let Some(column) = columns.iter().position(|own| own == name) else { continue };
            for (point, unknown) in self.unknowns.iter().enumerate() {
                let first = self.term_parameters + unknown.first;
                let touches = |meta: &&Block| self.columns[meta.group].contains(&first);
                let rows = readings.blocks().iter().filter(touches);
                let rows = rows.flat_map(|meta| &meta.rows[..meta.live]);
                let told = rows.map(|&row| readings.table.columns[column][row]);
                let told: Vec<f64> = told.filter(|value| !value.is_nan()).collect();
                let (sum, count) = (told.iter().sum(), told.len() as f64);
                all.push(MeasuredLink { closure, point, sum, count });
            }
        }
        self.measured_links = all;
    }

    /// Columns and values of an unknown point that are not fixed; `None` for a point with other
    /// values in the fixed columns.
    fn free_keys<'a>(
        &'a self,
        point: usize,
        keys: &'a [String],
        fixed: &[(usize, String)],
    ) -> Option<Vec<(&'a String, &'a String)>> {
        let columns = self.mechanism.points[point].keys();
        if fixed.iter().any(|(k, value)| keys.get(*k) != Some(value)) {
            return None;
        }
        let free = |k: &usize| fixed.iter().all(|(f, _)| f != k);
        let mut rest: Vec<_> =
            (0..keys.len()).filter(free).map(|k| (&columns[k], &keys[k])).collect();
        rest.sort();
        Some(rest)
    }

    /// Sets each unknown point to the mean of the positions at which it is touched, each unknown
    /// plane or line through the points that are on it, and each unknown frame where its points are nearest
    /// to those that they touch. What is somewhere else in each pose is where closures put it that touch
    /// nothing unknown. `beta` holds one number per parameter.
    ///
    /// Returns the frames that these places do not tell, by their numbers: they are as drawn, or, where they
    /// are not drawn, where the poses as drawn have them.
    pub fn place_unknowns(&self, readings: &Readings, beta: &mut [f64]) -> Vec<usize> {
        let known = self.of_known();
        let told = |block, ws: &mut Workspace| known.told_poses(readings, block, beta, ws);
        let touched = self.touched(readings, beta, told);
        let on = self.points_on(readings, beta);
        let untold = |(k, own): (usize, &Touched)| {
            let frame = matches!(self.unknowns[k].thing, Thing::Frame(_));
            (frame && own.pairs.len() < ENOUGH).then_some(k)
        };
        let untold: Vec<usize> = touched.iter().enumerate().filter_map(untold).collect();
        let as_drawn = (!untold.is_empty() && self.pose_unknowns() > 0).then(|| {
            let near = |block, ws: &mut Workspace| {
                known.placed(readings, block, readings.raw(block), beta, ws)
            };
            self.touched(readings, beta, near)
        });
        for (k, unknown) in self.unknowns.iter().enumerate() {
            let own = &mut beta[self.term_parameters + unknown.first..][..unknown.width];
            let Touched { places, pairs, spheres } = &touched[k];
            match unknown.thing {
                Thing::Point(p) if !places.is_empty() => {
                    let mean = places.iter().sum::<Vector3<f64>>() / places.len() as f64;
                    let free = self.mechanism.points[p].frees();
                    let free = (0..3).filter(|&axis| free[axis]).map(|axis| mean[axis]);
                    own.iter_mut().zip(free).for_each(|(own, at)| *own = at);
                }
                Thing::Point(p) if !self.mechanism.points[p].frees().contains(&false) => {
                    let near = self.mechanism.points[p].at.unwrap_or_default();
                    if let Some(at) = amid(spheres, near.into()) {
                        own.copy_from_slice(at.as_slice());
                    }
                }
                Thing::Plane(_) | Thing::Line(_) => {
                    let Some([faces, middle]) = unknown.thing.nearest(&on[k]) else { continue };
                    let [lean, one, other] =
                        self.axes[k].map(|axis| faces.dot(&Vector3::from(axis)));
                    // What is across the axis has no finite tilt.
                    if lean.abs() > 0.1 {
                        let tilts = [one / lean, other / lean];
                        let at = unknown.thing.through(&self.axes[k], tilts, &middle);
                        own.copy_from_slice(&at);
                    }
                }
                Thing::Frame(f) => {
                    let drawn = self.mechanism.frames[f].pose;
                    let near = as_drawn.as_ref().filter(|_| drawn.is_none());
                    let near = near.map(|all| &all[k].pairs);
                    let pairs = Some(pairs).filter(|p| p.len() >= ENOUGH).or(near);
                    if let Some(pairs) = pairs.filter(|pairs| pairs.len() >= ENOUGH) {
                        let (seen, there): (Vec<_>, Vec<_>) = pairs.iter().copied().unzip();
                        own.copy_from_slice(&match drawn {
                            Some([.., rx, ry, rz]) => {
                                let drawn = Rotation3::from_euler_angles(rx, ry, rz);
                                rigid_fit_near(&seen, &there, &drawn)
                            }
                            None => rigid_fit(&seen, &there),
                        });
                    }
                }
                Thing::Point(_) => {}
            }
        }
        untold
    }

    /// What each unknown touches, with the readings and what is unknown in their poses of each block as `poses`
    /// has them.
    fn touched(
        &self,
        readings: &Readings,
        beta: &[f64],
        poses: impl Fn(usize, &mut Workspace) -> Vec<Lanes>,
    ) -> Vec<Touched> {
        let mut touched = vec![Touched::default(); self.unknowns.len()];
        let mut ws = Workspace::default();
        for (block, meta) in readings.blocks().iter().enumerate() {
            let a = poses(block, &mut ws);
            self.evaluate(readings, block, &a, beta, Want { x: false, a: false }, &mut ws);
            let seen = readings.columns(block);
            self.spheres_of(readings, block, beta, &ws, &mut touched);
            let at = |end: &End| self.end_point(end, meta.group, seen, beta, &ws);
            for closure in self.closures.iter().filter(|c| c.kind.facts().is_vector) {
                let lanes = |at: &Vec3| -> Vec<Vector3<f64>> {
                    let lanes = readings.lanes(block, closure.number);
                    lanes.map(|lane| Vector3::from_fn(|i, _| at[i].0[lane])).collect()
                };
                for (end, other) in
                    [(0, 1), (1, 0)].map(|(i, j)| (closure.ends[i], closure.ends[j]))
                {
                    if !is_known(&other) {
                        continue;
                    }
                    let there = lanes(&at(&other));
                    match end {
                        End::Unknown(point, ..) => {
                            let own = &mut touched[self.owned[point].numbers[meta.group]];
                            own.places.extend(there.into_iter().filter(is_told));
                        }
                        End::Seen(columns, Measured::Unknown(frame), _) => {
                            let own = &mut touched[self.owned[frame].numbers[meta.group]];
                            let seen = lanes(&columns.map(|column| seen[column]));
                            let told = seen.into_iter().zip(there).filter(|(_, at)| is_told(at));
                            own.pairs.extend(told);
                        }
                        _ => {}
                    }
                }
            }
        }
        touched
    }

    /// For each unknown, the points that are on it, where it is a plane or a line.
    pub(crate) fn points_on(&self, readings: &Readings, beta: &[f64]) -> Vec<Vec<Vector3<f64>>> {
        let mut points = vec![Vec::new(); self.unknowns.len()];
        let mut ws = Workspace::default();
        let known = self.of_known();
        for (block, meta) in readings.blocks().iter().enumerate() {
            let want = Want { x: false, a: false };
            let a = known.told_poses(readings, block, beta, &mut ws);
            self.evaluate(readings, block, &a, beta, want, &mut ws);
            for closure in &self.closures {
                let Some(thing) = closure.on else { continue };
                let seen = readings.columns(block);
                let at = self.end_point(&closure.ends[0], meta.group, seen, beta, &ws);
                let own = &mut points[self.owned[thing].numbers[meta.group]];
                let lanes = readings.lanes(block, closure.number);
                let lanes = lanes.map(|lane| Vector3::from_fn(|i, _| at[i].0[lane]));
                own.extend(lanes.filter(is_told));
            }
        }
        points
    }

    /// Spheres on which unknown points are, by their known distances from known points.
    fn spheres_of(
        &self,
        readings: &Readings,
        block: usize,
        beta: &[f64],
        ws: &Workspace,
        touched: &mut [Touched],
    ) {
        let (meta, seen) = (&readings.blocks()[block], readings.columns(block));
        let lengths = |closure: &&CompiledClosure| {
            closure.kind.facts().given == Given::Value && closure.equations() > 0
        };
        for closure in self.closures.iter().filter(lengths) {
            let (number, other) = match closure.ends {
                [End::Unknown(number, ..), other] | [other, End::Unknown(number, ..)] => {
                    (number, other)
                }
                _ => continue,
            };
            if !is_known(&other) || matches!(other, End::Posed(_)) {
                continue;
            }
            let at = self.end_point(&other, meta.group, seen, beta, ws);
            let long = match (closure.channel, closure.column) {
                (Some(channel), _) => ws.angles[channel],
                (None, Some(column)) => seen[column],
                (None, None) => Lanes::splat(closure.value),
            };
            let own = &mut touched[self.owned[number].numbers[meta.group]].spheres;
            let centre = |lane: usize| Vector3::from_fn(|i, _| at[i].0[lane]);
            let lanes = readings.lanes(block, closure.number);
            own.extend(lanes.map(|lane| (centre(lane), long.0[lane])));
        }
    }

    /// First parameters of the wholly unknown points that the samples of a group touch.
    #[must_use]
    pub(crate) fn free_points(&self, group: usize) -> Vec<usize> {
        let points = self.owned.iter().enumerate();
        let whole = |o: &Owned| matches!(o.thing, Thing::Point(_)) && o.width == 3;
        points.filter(|(_, o)| whole(o)).map(|(k, _)| self.unknown_first(k, group)).collect()
    }

    /// Parameters of what is unknown that no sample with a weight above zero tells of. `weights` holds
    /// one number per sample.
    #[must_use]
    pub fn untouched(&self, readings: &Readings, weights: &[f64]) -> Vec<usize> {
        let mut touched = vec![false; self.unknowns.len()];
        for (number, block) in readings.blocks().iter().enumerate() {
            for (k, thing) in self.owned.iter().enumerate() {
                let own = |c: &&CompiledClosure| c.unknowns().any(|of| of == k);
                let counts = |c: &CompiledClosure| {
                    readings.lanes(number, c.number).any(|lane| weights[block.rows[lane]] > 0.0)
                };
                if self.closures.iter().filter(own).any(counts) {
                    touched[thing.numbers[block.group]] = true;
                }
            }
        }
        let left = self.unknowns.iter().zip(touched).filter(|(_, touched)| !*touched);
        left.flat_map(|(u, _)| (0..u.width).map(|k| self.term_parameters + u.first + k)).collect()
    }
}

/// True for an end that is nothing unknown.
fn is_known(end: &End) -> bool {
    !matches!(end, End::Unknown(..) | End::Seen(_, Measured::Unknown(_), _))
}

/// True for a place that readings and terms tell.
fn is_told(at: &Vector3<f64>) -> bool {
    at.iter().all(|x| x.is_finite())
}
