//! Numbers of the unknown points: one for each distinct combination of key values.

use crate::mechanism::Mechanism;
use crate::readings::Readings;

/// What results call an unknown point, in the place of a term.
pub const UNKNOWN_POINT: &str = "unknown_point";

/// Name of an unknown point: `socket[group=front,at=socket0]`.
pub(crate) fn unknown_name(mechanism: &Mechanism, point: usize, keys: &[String]) -> String {
    let point = &mechanism.points[point];
    let keys: Vec<String> =
        point.keys().iter().zip(keys).map(|(column, key)| format!("{column}={key}")).collect();
    format!("{}[{}]", point.name, keys.join(","))
}

/// Index of a point of the mechanism, and the key values that distinguish one unknown point.
type Keyed = (usize, Vec<String>);

/// Numbers the unknown points. The first result holds, for each point of the mechanism with keys
/// and for each group, the number of the unknown point; the second describes each number.
pub(crate) fn number_unknowns(
    mechanism: &Mechanism,
    readings: &Readings,
) -> (Vec<Vec<usize>>, Vec<Keyed>) {
    let columns = mechanism.key_columns();
    let mut numbers = Vec::new();
    let mut points: Vec<Keyed> = Vec::new();
    for (p, point) in mechanism.points.iter().enumerate().filter(|(_, p)| p.is_unknown()) {
        let of_group = readings.groups.iter().map(|group| {
            let key = |c: &String| columns.iter().position(|k| k == c).map(|i| group[i].clone());
            let own = (p, point.keys().iter().filter_map(key).collect::<Vec<String>>());
            points.iter().position(|known| *known == own).unwrap_or_else(|| {
                points.push(own);
                points.len() - 1
            })
        });
        numbers.push(of_group.collect());
    }
    (numbers, points)
}
