//! How bright a light is from place to place.

use glam::DVec2;
use serde::{Deserialize, Serialize};

/// How bright a rectangle or a disc of light is from place to place: an image over its sides, of constant cells. Only ratios
/// matter; they are kept relative to the image's mean. A colour has three of them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Image", into = "Image")]
pub struct Emission {
    columns: u32,
    rows: u32,
    values: Vec<f64>,
}

/// The serialised form.
#[derive(Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Image {
    columns: u32,
    rows: u32,
    values: Vec<f64>,
}

/// An image that no light can have.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EmissionError {
    /// As many values as cells there must be.
    #[error(
        "an emission of {columns} x {rows} cells has {values} values; give one a cell, row by row, and at least one"
    )]
    Size {
        /// Cells along the light's first side.
        columns: u32,
        /// Cells along its second side.
        rows: u32,
        /// Values given.
        values: usize,
    },
    /// A cell that is negative, infinite or not a number.
    #[error("value {index} of an emission is {value}; use finite numbers of at least 0")]
    Value {
        /// The first such cell.
        index: usize,
        /// Its value.
        value: f64,
    },
    /// No cell shines.
    #[error("an emission is 0 everywhere; let some of it shine, or leave the light out")]
    Dark,
}

impl Emission {
    /// Of `columns` x `rows` values, row by row: the first one is that of the corner where both of the light's own coordinates
    /// are -1, columns count along `half_u` or `axis_u`, rows along `half_v` or `axis_v`.
    ///
    /// # Errors
    /// Not one value a cell, one that is negative or not finite, or none above 0.
    pub fn new(columns: u32, rows: u32, values: &[f64]) -> Result<Self, EmissionError> {
        let cells = u64::from(columns) * u64::from(rows);
        if cells == 0 || cells != values.len() as u64 {
            return Err(EmissionError::Size { columns, rows, values: values.len() });
        }
        let is_wrong = |value: &f64| !value.is_finite() || *value < 0.0;
        if let Some(index) = values.iter().position(is_wrong) {
            return Err(EmissionError::Value { index, value: values[index] });
        }
        // By the greatest first, so that no sum overflows.
        let most = values.iter().copied().fold(0.0, f64::max);
        if most == 0.0 {
            return Err(EmissionError::Dark);
        }
        let mean = values.iter().map(|value| value / most).sum::<f64>() / cells as f64;
        Ok(Self { columns, rows, values: values.iter().map(|value| value / most / mean).collect() })
    }

    /// Emission at a point in the light's own coordinates, [-1, 1]², relative to the mean over that square.
    #[must_use]
    pub fn at(&self, s: DVec2) -> f64 {
        let sides = DVec2::new(f64::from(self.columns), f64::from(self.rows));
        let cell = (0.5 * (s + 1.0) * sides).floor().clamp(DVec2::ZERO, sides - 1.0);
        self.value(cell.x as u32, cell.y as u32)
    }

    fn value(&self, column: u32, row: u32) -> f64 {
        self.values[(row * self.columns + column) as usize]
    }

    /// Means over `side` x `side` cells of the light, in the same order.
    #[must_use]
    pub fn means(&self, side: u32) -> Vec<f64> {
        let mean = |row: u32, column: u32| -> f64 {
            let along_v = shares(self.rows, side, row);
            along_v
                .flat_map(|(y, b)| {
                    shares(self.columns, side, column).map(move |(x, a)| (x, y, a * b))
                })
                .map(|(x, y, share)| share * self.value(x, y))
                .sum()
        };
        (0..side)
            .flat_map(|row| (0..side).map(move |column| (row, column)))
            .map(|(r, c)| mean(r, c))
            .collect()
    }
}

/// Of `cells` along a side those that lie in part `k` of `parts`, and the share of it that each has.
fn shares(cells: u32, parts: u32, k: u32) -> impl Iterator<Item = (u32, f64)> {
    let per_part = f64::from(cells) / f64::from(parts);
    let (from, to) = (f64::from(k) * per_part, f64::from(k + 1) * per_part);
    let last = (to.ceil() as u32).min(cells);
    (from as u32..last).map(move |cell| {
        let (begin, end) = (f64::from(cell).max(from), f64::from(cell + 1).min(to));
        (cell, (end - begin).max(0.0) / per_part)
    })
}

impl TryFrom<Image> for Emission {
    type Error = EmissionError;

    fn try_from(image: Image) -> Result<Self, EmissionError> {
        Self::new(image.columns, image.rows, &image.values)
    }
}

impl From<Emission> for Image {
    fn from(emission: Emission) -> Self {
        let Emission { columns, rows, values } = emission;
        Self { columns, rows, values }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_that_no_light_can_have_are_refused_with_a_fix() {
        let size = |columns, rows, count| Emission::new(columns, rows, &vec![1.0; count]);
        for (columns, rows, count) in [(0, 4, 0), (2, 2, 3), (u32::MAX, u32::MAX, 4)] {
            assert!(
                matches!(size(columns, rows, count), Err(EmissionError::Size { .. })),
                "{columns} x {rows} of {count}"
            );
        }
        for wrong in [-1.0, f64::NAN, f64::INFINITY] {
            let found = Emission::new(2, 1, &[1.0, wrong]);
            assert!(matches!(found, Err(EmissionError::Value { index: 1, .. })), "{wrong}");
        }
        assert_eq!(Emission::new(2, 1, &[0.0, 0.0]), Err(EmissionError::Dark), "all dark");
        let text = r#"{ "columns": 2, "rows": 1, "values": [0, 0] }"#;
        let read = serde_json::from_str::<Emission>(text).map_err(|error| error.to_string());
        assert!(read.is_err_and(|e| e.contains("0 everywhere")), "read from a file");
        assert!(size(3, 2, 6).is_ok(), "the control");
    }

    #[test]
    fn means_of_any_number_of_cells_have_the_mean_1_and_those_of_its_own_are_its_values() {
        let values: Vec<f64> = (0..12).map(|i| f64::from(i * i % 7)).collect();
        let emission = Emission::new(4, 3, &values).expect("a valid image");
        for side in [1, 2, 5, 12, 16] {
            let means = emission.means(side);
            let mean = means.iter().sum::<f64>() / f64::from(side * side);
            assert!((mean - 1.0).abs() < 1e-12, "{side}: {mean}");
        }
        let fine = emission.means(12);
        for (i, mean) in fine.iter().enumerate() {
            let at = |i: usize| (i as f64 + 0.5) / 6.0 - 1.0;
            let expected = emission.at(DVec2::new(at(i % 12), at(i / 12)));
            assert!((mean - expected).abs() < 1e-12, "{i}: {mean}, {expected}");
        }
        let huge = Emission::new(2, 1, &[f64::MAX, 0.0]).expect("a valid image");
        assert_eq!(huge.at(DVec2::new(-0.5, 0.0)), 2.0, "relative to the mean");
    }
}
