//! From raw vertices and indices to a mesh that holds what the rest of the workspace relies on.

use std::collections::HashMap;

use glam::{Vec2, Vec3};

use super::Repairs;
use crate::{Mesh, MeshError};

/// The vertices to build from.
#[derive(Clone, Copy)]
pub(super) enum Source<'a> {
    /// Vertices at the same position become one.
    Welded(&'a [Vec3]),
    /// Vertices stay as they are.
    Separate(&'a [Vec3]),
}

/// A mesh of those triangles that are finite and have an area, and of the vertices they use; the
/// others are counted in `repairs`.
///
/// # Errors
/// The first triangle with an index beyond the vertices.
pub(super) fn clean(
    name: String,
    source: Source<'_>,
    triangles: impl Iterator<Item = [u32; 3]>,
    repairs: &mut Repairs,
) -> Result<Mesh, MeshError> {
    clean_with_uv(name, source, None, triangles, repairs).map(|(mesh, _)| mesh)
}

/// As [`clean`], with the vertices' texture coordinates where they matter: then vertices become one only where these are
/// the same too.
///
/// # Errors
/// As [`clean`].
pub(super) fn clean_with_uv(
    name: String,
    source: Source<'_>,
    uv: Option<&[Vec2]>,
    triangles: impl Iterator<Item = [u32; 3]>,
    repairs: &mut Repairs,
) -> Result<(Mesh, Option<Vec<Vec2>>), MeshError> {
    let mut kept_uv = uv.map(|_| Vec::new());
    let (Source::Welded(positions) | Source::Separate(positions)) = source;
    let mut mesh = Mesh { name, ..Mesh::default() };
    let mut kept = HashMap::new();
    for (number, triangle) in triangles.enumerate() {
        let mut corners = [Vec3::ZERO; 3];
        for (corner, &index) in corners.iter_mut().zip(&triangle) {
            let Some(&p) = positions.get(index as usize) else {
                return Err(MeshError::IndexOutOfRange {
                    mesh: mesh.name,
                    triangle: number,
                    vertices: positions.len(),
                });
            };
            // Adding zero makes a negative zero positive, so that equal positions have equal bits.
            *corner = p + Vec3::ZERO;
        }
        if !corners.iter().all(|p| p.is_finite()) {
            repairs.non_finite_triangles += 1;
            continue;
        }
        if has_no_area(corners) {
            repairs.degenerate_triangles += 1;
            continue;
        }
        let mut out = [0; 3];
        for i in 0..3 {
            let at = uv.and_then(|uv| uv.get(triangle[i] as usize)).map_or(Vec2::ZERO, |uv| *uv);
            let key = match source {
                Source::Welded(_) => {
                    let [x, y, z] = corners[i].to_array().map(f32::to_bits);
                    [x, y, z, at.x.to_bits(), at.y.to_bits()]
                }
                Source::Separate(_) => [triangle[i], 0, 0, 0, 0],
            };
            out[i] = *kept.entry(key).or_insert_with(|| {
                mesh.positions.push(corners[i]);
                kept_uv.as_mut().into_iter().for_each(|kept| kept.push(at));
                // As many vertices as there are 32-bit indices or bit patterns used at most; the
                // limit on triangles is far below.
                (mesh.positions.len() - 1) as u32
            });
        }
        mesh.triangles.push(out);
    }
    Ok((mesh, kept_uv))
}

/// Whether the corners lie on a line. In f64 the products of two differences of f32 values of like
/// size are exact, and so then is the verdict.
fn has_no_area([a, b, c]: [Vec3; 3]) -> bool {
    let (a, b, c) = (a.as_dvec3(), b.as_dvec3(), c.as_dvec3());
    (b - a).cross(c - a) == glam::DVec3::ZERO
}
