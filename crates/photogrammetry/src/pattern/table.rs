//! The table of beams that a pattern file may name: `model: {table: {file: beams.csv}}`.
//!
//! A CSV file, one line a beam in any order, under the heading `m,n,x,y` or `m,n,x,y,z`. (m, n) is
//! the beam's order: m columns to the right, n rows down. With `x,y` the beam goes through (x, y, 1)
//! in the module frame (x right, y down, z forward), with `x,y,z` through (x, y, z); the length does
//! not count. Empty lines and what follows `#` are passed over.

use std::collections::BTreeMap;

/// Reads a table for a pattern of `[columns, rows]`: each beam as (x, y) on the plane z = 1, row by
/// row from the top left. `name` is the file's, for messages.
///
/// # Errors
/// What is wrong and in which line, for people.
pub fn read_table(
    name: &str,
    text: &str,
    [columns, rows]: [u32; 2],
) -> Result<Vec<[f64; 2]>, String> {
    let (half_m, half_n) = (i64::from(columns / 2), i64::from(rows / 2));
    let lines = text.strip_prefix('\u{feff}').unwrap_or(text).lines().enumerate();
    let mut lines = lines
        .map(|(at, line)| (at + 1, line.split('#').next().unwrap_or_default().trim()))
        .filter(|(_, line)| !line.is_empty());
    let (_, heading) = lines.next().ok_or_else(|| format!("{name}: the table is empty"))?;
    let heading: Vec<&str> = heading.split(',').map(str::trim).collect();
    let with_z = match heading.as_slice() {
        ["m", "n", "x", "y"] => false,
        ["m", "n", "x", "y", "z"] => true,
        _ => return Err(format!("{name}: the heading must be `m,n,x,y` or `m,n,x,y,z`")),
    };
    let mut beams = BTreeMap::new();
    for (at, line) in lines {
        let ([m, n], tangent) = beam(line, with_z).map_err(|why| format!("{name}:{at}: {why}"))?;
        if m.abs() > half_m || n.abs() > half_n {
            let size = format!("{columns} x {rows} beams");
            return Err(format!("{name}:{at}: the pattern of {size} has no beam ({m}, {n})"));
        }
        if beams.insert((n, m), tangent).is_some() {
            return Err(format!("{name}:{at}: beam ({m}, {n}) repeats"));
        }
    }
    let orders = (-half_n..=half_n).flat_map(|n| (-half_m..=half_m).map(move |m| (n, m)));
    if let Some((n, m)) = orders.into_iter().find(|order| !beams.contains_key(order)) {
        let (found, expected) = (beams.len(), columns * rows);
        return Err(format!(
            "{name}: beam ({m}, {n}) is missing: {found} of {expected} beams are there"
        ));
    }
    Ok(beams.into_values().collect())
}

/// One line: the order and (x, y) on the plane z = 1.
fn beam(line: &str, with_z: bool) -> Result<([i64; 2], [f64; 2]), String> {
    let cells: Vec<&str> = line.split(',').map(str::trim).collect();
    let expected = if with_z { 5 } else { 4 };
    if cells.len() != expected {
        return Err(format!("expected {expected} values, found {}", cells.len()));
    }
    let order = |at: usize| {
        let cell = cells[at];
        cell.parse::<i32>()
            .map(i64::from)
            .map_err(|_| format!("expected a whole number, found `{cell}`"))
    };
    let number = |at: usize| match cells[at].parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        _ => Err(format!("expected a number, found `{}`", cells[at])),
    };
    let z = if with_z { number(4)? } else { 1.0 };
    if z <= 0.0 {
        return Err(format!("z is {z}: beams go forward, so it must be above 0"));
    }
    let tangent = [number(2)? / z, number(3)? / z];
    if !tangent.iter().all(|t| t.is_finite()) {
        return Err(format!("z is {z}: too small for a direction"));
    }
    Ok(([order(0)?, order(1)?], tangent))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(heading: &str, line: impl Fn(i32, i32) -> String) -> String {
        let beams = (-1..=1).flat_map(|m| (-1..=1).map(move |n| (m, n)));
        let lines: Vec<String> = beams.map(|(m, n)| line(m, n)).collect();
        format!("# a fan\n{heading}\n\n{}\n", lines.join("\n"))
    }

    #[test]
    fn tangents_and_directions_of_any_length_say_the_same_in_any_order() {
        let tangents = table("m,n,x,y", |m, n| format!("{m},{n},{},{}", m as f64 / 4.0, n));
        let directions = table("m, n, x, y, z", |m, n| format!("{m}, {n}, {m}, {}, 4 # ok", 4 * n));
        let read = read_table("beams.csv", &tangents, [3, 3]).unwrap();
        assert_eq!(read[..3], [[-0.25, -1.0], [0.0, -1.0], [0.25, -1.0]]);
        assert_eq!(read, read_table("beams.csv", &directions, [3, 3]).unwrap());
    }

    #[test]
    fn a_table_that_is_wrong_is_refused_with_its_line() {
        let told = |text: &str| read_table("beams.csv", text, [3, 3]).unwrap_err();
        let cases = [
            ("", "beams.csv: the table is empty"),
            ("m,n,y,x\n", "beams.csv: the heading must be `m,n,x,y` or `m,n,x,y,z`"),
            ("m,n,x,y\n0,0,0\n", "beams.csv:2: expected 4 values, found 3"),
            ("m,n,x,y\n0,0,0,NaN\n", "beams.csv:2: expected a number, found `NaN`"),
            ("m,n,x,y\n0.5,0,0,0\n", "beams.csv:2: expected a whole number, found `0.5`"),
            (
                "m,n,x,y,z\n0,0,0,0,-1\n",
                "beams.csv:2: z is -1: beams go forward, so it must be above 0",
            ),
            ("m,n,x,y\n2,0,0,0\n", "beams.csv:2: the pattern of 3 x 3 beams has no beam (2, 0)"),
            ("m,n,x,y\n0,0,0,0\n\n0,0,0,0\n", "beams.csv:4: beam (0, 0) repeats"),
            ("m,n,x,y\n0,0,0,0\n", "beams.csv: beam (-1, -1) is missing: 1 of 9 beams are there"),
        ];
        for (text, expected) in cases {
            assert_eq!(told(text), expected);
        }
    }
}
