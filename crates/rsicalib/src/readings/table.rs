//! Readings as they come: a table, row by row.

/// Readings as they come, row by row.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    /// Readings, row by row, one per channel of the mechanism.
    pub values: Vec<f64>,
    /// Label of the held pose of each row; none for a recording in motion.
    pub pose: Option<Vec<i64>>,
    /// Time of each row [s].
    pub time: Option<Vec<f64>>,
    /// Temperature at each row [°C].
    pub temperature: Option<Vec<f64>>,
    /// Observations of each row, counted from 0; none for a single one.
    pub session: Option<Vec<usize>>,
    /// For each key column of the mechanism, its text in each row.
    pub keys: Vec<Vec<String>>,
    /// For each value column of the mechanism, its number in each row.
    pub columns: Vec<Vec<f64>>,
}

/// One row for each pose: the mean of its samples.
#[must_use]
pub fn average(table: &Table, channels: usize) -> (Table, Vec<Vec<usize>>) {
    let rows = table.values.len() / channels;
    let mut poses: Vec<Vec<usize>> = Vec::new();
    match &table.pose {
        None => poses.extend((0..rows).map(|r| vec![r])),
        Some(labels) => {
            let mut last = None;
            for (row, label) in labels.iter().enumerate() {
                match poses.last_mut() {
                    Some(pose) if last == Some(label) => pose.push(row),
                    _ => poses.push(vec![row]),
                }
                last = Some(label);
            }
        }
    }
    let mean = |f: &dyn Fn(usize) -> f64, pose: &[usize]| {
        pose.iter().map(|&r| f(r)).sum::<f64>() / pose.len() as f64
    };
    let column = |values: &Option<Vec<f64>>| {
        values.as_ref().map(|v| poses.iter().map(|p| mean(&|r| v[r], p)).collect::<Vec<f64>>())
    };
    let first = |p: &Vec<usize>| p[0];
    let averaged = Table {
        values: poses
            .iter()
            .flat_map(|p| (0..channels).map(move |c| (p, c)))
            .map(|(p, c)| mean(&|r| table.values[r * channels + c], p))
            .collect(),
        pose: table.pose.as_ref().map(|labels| poses.iter().map(|p| labels[p[0]]).collect()),
        time: column(&table.time),
        temperature: column(&table.temperature),
        session: table.session.as_ref().map(|s| poses.iter().map(|p| s[p[0]]).collect()),
        keys: table
            .keys
            .iter()
            .map(|k| poses.iter().map(|p| k[first(p)].clone()).collect())
            .collect(),
        columns: table
            .columns
            .iter()
            .map(|v| poses.iter().map(|p| mean(&|r| v[r], p)).collect())
            .collect(),
    };
    (averaged, poses)
}

/// Some rows of a table.
#[must_use]
pub fn rows_of(table: &Table, channels: usize, rows: &[usize]) -> Table {
    let pick = |column: &Vec<f64>| rows.iter().map(|&r| column[r]).collect::<Vec<_>>();
    Table {
        values: rows
            .iter()
            .flat_map(|r| table.values[r * channels..(r + 1) * channels].iter().copied())
            .collect(),
        pose: table.pose.as_ref().map(|p| rows.iter().map(|&r| p[r]).collect()),
        time: table.time.as_ref().map(pick),
        temperature: table.temperature.as_ref().map(pick),
        session: table.session.as_ref().map(|s| rows.iter().map(|&r| s[r]).collect()),
        keys: table.keys.iter().map(|key| rows.iter().map(|&r| key[r].clone()).collect()).collect(),
        columns: table.columns.iter().map(pick).collect(),
    }
}
