//! The matrices that prove a bound.

use nalgebra::DMatrix;
use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

/// A proof by Theorem 1's functional and Jensen's inequality [MCF, Eq. 9] that |z| <= gamma |w|.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Jensen {
    /// The bound.
    pub gamma: f64,
    /// P.
    #[serde(with = "rows")]
    pub p: DMatrix<f64>,
    /// Z1.
    #[serde(with = "rows")]
    pub z: DMatrix<f64>,
    /// Q1; without it the proof holds for delays of any rate.
    #[serde(default, with = "optional_rows", skip_serializing_if = "Option::is_none")]
    pub q: Option<DMatrix<f64>>,
}

/// A proof by Wirtinger's inequality with a reciprocally convex bound (Seuret and Gouaisbaut,
/// Automatica 49, 2013) that |z| <= gamma |w|, for delays of any rate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wirtinger {
    /// The bound.
    pub gamma: f64,
    /// P, twice the order of the plant.
    #[serde(with = "rows")]
    pub p: DMatrix<f64>,
    /// S.
    #[serde(with = "rows")]
    pub s: DMatrix<f64>,
    /// R.
    #[serde(with = "rows")]
    pub r: DMatrix<f64>,
    /// X, of no symmetry.
    #[serde(with = "rows")]
    pub x: DMatrix<f64>,
}

/// A matrix as a list of its rows.
mod rows {
    use super::{DMatrix, Deserialize, Deserializer, Serialize, Serializer, de};

    pub fn serialize<S: Serializer>(matrix: &DMatrix<f64>, out: S) -> Result<S::Ok, S::Error> {
        let rows: Vec<Vec<f64>> =
            matrix.row_iter().map(|row| row.iter().copied().collect()).collect();
        rows.serialize(out)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<DMatrix<f64>, D::Error> {
        let rows = Vec::<Vec<f64>>::deserialize(from)?;
        let columns = rows.first().map_or(0, Vec::len);
        if rows.iter().any(|row| row.len() != columns) {
            return Err(de::Error::custom("a matrix needs rows of one length"));
        }
        Ok(DMatrix::from_fn(rows.len(), columns, |i, j| rows[i][j]))
    }
}

/// The same, if there is one.
mod optional_rows {
    use super::{DMatrix, Deserializer, Serializer, rows};

    pub fn serialize<S: Serializer>(
        matrix: &Option<DMatrix<f64>>,
        out: S,
    ) -> Result<S::Ok, S::Error> {
        match matrix {
            Some(matrix) => rows::serialize(matrix, out),
            None => out.serialize_none(),
        }
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(
        from: D,
    ) -> Result<Option<DMatrix<f64>>, D::Error> {
        rows::deserialize(from).map(Some)
    }
}
