//! Triangle meshes and boxes.

use glam::{DAffine3, DVec3, Vec3};

use crate::MeshError;

/// An indexed triangle mesh. Winding carries no meaning: every technique treats both sides alike
/// unless its page says otherwise.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Name, for messages and files.
    pub name: String,
    /// Vertex positions, metres, in the mesh's own space. All finite.
    pub positions: Vec<Vec3>,
    /// Three vertex indices a triangle, each below `positions.len()`.
    pub triangles: Vec<[u32; 3]>,
}

impl Mesh {
    /// The same mesh under another name.
    #[must_use]
    pub fn named(mut self, name: impl Into<String>) -> Self {
        self.name = name.into();
        self
    }

    /// Appends the vertices and triangles of `other`, whose indices move up accordingly.
    pub fn append(&mut self, other: &Self) {
        let base = self.positions.len() as u32;
        self.positions.extend_from_slice(&other.positions);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|i| i + base)));
    }

    /// The box around all vertices, mesh space.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        Bounds::of(self.positions.iter().map(|p| p.as_dvec3()))
    }

    /// Checks that every position is finite and every index in range.
    ///
    /// # Errors
    /// Names the first offending vertex or triangle.
    pub fn validate(&self) -> Result<(), MeshError> {
        if let Some(vertex) = self.positions.iter().position(|p| !p.is_finite()) {
            return Err(MeshError::NonFinite { mesh: self.name.clone(), vertex });
        }
        let count = self.positions.len();
        match self.triangles.iter().position(|t| t.iter().any(|&i| i as usize >= count)) {
            Some(triangle) => Err(MeshError::IndexOutOfRange {
                mesh: self.name.clone(),
                triangle,
                vertices: count,
            }),
            None => Ok(()),
        }
    }
}

/// An axis-aligned box; empty when `min > max` on an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Smallest corner.
    pub min: DVec3,
    /// Largest corner.
    pub max: DVec3,
}

impl Bounds {
    /// The box that contains nothing.
    pub const EMPTY: Self = Self { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    /// The smallest box around `points`.
    #[must_use]
    pub fn of(points: impl IntoIterator<Item = DVec3>) -> Self {
        points.into_iter().fold(Self::EMPTY, |b, p| Self { min: b.min.min(p), max: b.max.max(p) })
    }

    /// Whether nothing lies inside.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.min.cmpgt(self.max).any()
    }

    /// The smallest box around both.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// The middle of the box.
    #[must_use]
    pub fn center(&self) -> DVec3 {
        0.5 * (self.min + self.max)
    }

    /// Half of the diagonal, the radius of the sphere around the box.
    #[must_use]
    pub fn radius(&self) -> f64 {
        if self.is_empty() { 0.0 } else { 0.5 * (self.max - self.min).length() }
    }

    /// The eight corners.
    #[must_use]
    pub fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|i| {
            DVec3::new(
                if i & 1 == 0 { self.min.x } else { self.max.x },
                if i & 2 == 0 { self.min.y } else { self.max.y },
                if i & 4 == 0 { self.min.z } else { self.max.z },
            )
        })
    }

    /// The box around the transformed box.
    #[must_use]
    pub fn transformed(&self, transform: &DAffine3) -> Self {
        if self.is_empty() {
            return *self;
        }
        Self::of(self.corners().map(|c| transform.transform_point3(c)))
    }
}
