//! Edges of triangle soups: which triangles meet at each, and how they run along it.
//!
//! The silhouette of anything, seen from anywhere, is a set of these edges. Vertices are welded by position,
//! so that a mesh whose vertices are split (for texture coordinates, say) is as closed as it looks. Nothing is
//! assumed of the mesh: an edge may have any number of triangles, in either direction.

use std::collections::HashMap;

use glam::{DVec3, Vec3};

use crate::{Gpu, GpuError};

/// The edges of a list of triangles. The same triangles give the same lists.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Edges {
    /// The two vertices of each edge, of those at the same position the ones with the smallest index; the
    /// smaller index comes first. In ascending order.
    pub vertices: Vec<[u32; 2]>,
    /// Where the uses of each edge begin in `uses`, and in the end their number: one more than edges.
    pub first: Vec<u32>,
    /// Uses of edges: twice the triangle's index, plus 1 where the triangle runs from the edge's second vertex
    /// to its first. Those of one edge stand together, in the order of the triangles.
    pub uses: Vec<u32>,
    /// For each triangle its body, of `bodies`.
    pub body: Vec<u32>,
    /// The bodies, in the order of their first triangles.
    pub bodies: Vec<Body>,
    /// The first edge that keeps the mesh from being a manifold with boundary.
    pub not_manifold: Option<EdgeFault>,
    /// The first edge that keeps the mesh from being watertight.
    pub not_watertight: Option<EdgeFault>,
}

/// Triangles that hang together by edges. Closed where each edge has two of them, in opposite directions.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct Body {
    /// Smallest corner of the box around it.
    pub min: [f32; 3],
    /// Of a closed body +1 where its triangles are counter-clockwise seen from outside, -1 where they are
    /// clockwise; 0 where it is not closed or encloses no volume.
    pub outward: f32,
    /// Largest corner of the box around it.
    pub max: [f32; 3],
    /// Unused.
    pub unused: f32,
}

/// An edge that is not as a mesh of some kind wants it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EdgeFault {
    /// The edge's vertices.
    pub vertices: [u32; 2],
    /// Triangles that run from the first to the second.
    pub along: u32,
    /// Triangles that run from the second to the first.
    pub against: u32,
}

impl Edges {
    /// The edges of `triangles`, whose indices are in range. Triangles with two corners at one position have
    /// none.
    #[must_use]
    pub fn new(positions: &[Vec3], triangles: &[[u32; 3]]) -> Self {
        let weld = weld(positions);
        // Sorted by edge and then by triangle.
        let mut sides: Vec<([u32; 2], u32)> = Vec::with_capacity(3 * triangles.len());
        for (index, triangle) in triangles.iter().enumerate() {
            let [a, b, c] = triangle.map(|i| weld[i as usize]);
            if a != b && b != c && c != a {
                let side = |from: u32, to: u32| {
                    ([from.min(to), from.max(to)], 2 * index as u32 + u32::from(from > to))
                };
                sides.extend([side(a, b), side(b, c), side(c, a)]);
            }
        }
        sides.sort_unstable();
        let mut edges = Self::default();
        for (at, (vertices, used)) in sides.into_iter().enumerate() {
            if edges.vertices.last() != Some(&vertices) {
                edges.vertices.push(vertices);
                edges.first.push(at as u32);
            }
            edges.uses.push(used);
        }
        edges.first.push(edges.uses.len() as u32);
        edges.judge();
        edges.find_bodies(positions, triangles);
        edges
    }

    /// Number of edges.
    #[must_use]
    pub fn len(&self) -> usize {
        self.vertices.len()
    }

    /// Whether there is no edge.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.vertices.is_empty()
    }

    /// The uses of edge `edge`: each a triangle, and whether it runs against the edge.
    pub fn uses_of(&self, edge: usize) -> impl Iterator<Item = (usize, bool)> {
        let range = self.first[edge] as usize..self.first[edge + 1] as usize;
        self.uses[range].iter().map(|used| ((used >> 1) as usize, used & 1 == 1))
    }

    fn directions(&self, edge: usize) -> EdgeFault {
        let (against, along): (Vec<_>, Vec<_>) = self.uses_of(edge).partition(|(_, back)| *back);
        EdgeFault {
            vertices: self.vertices[edge],
            along: along.len() as u32,
            against: against.len() as u32,
        }
    }

    fn judge(&mut self) {
        let found = |fault: fn(&EdgeFault) -> bool| {
            (0..self.len()).map(|edge| self.directions(edge)).find(fault)
        };
        let not_manifold = found(|e| e.along > 1 || e.against > 1);
        let not_watertight = found(|e| (e.along, e.against) != (1, 1));
        (self.not_manifold, self.not_watertight) = (not_manifold, not_watertight);
    }

    /// Joins triangles over edges (union-find with the smallest index as root).
    fn find_bodies(&mut self, positions: &[Vec3], triangles: &[[u32; 3]]) {
        let mut parent: Vec<u32> = (0..triangles.len() as u32).collect();
        for edge in 0..self.len() {
            let mut uses = self.uses_of(edge).map(|(triangle, _)| triangle as u32);
            let Some(first) = uses.next() else { continue };
            for other in uses {
                let (a, b) = (root(&mut parent, first), root(&mut parent, other));
                parent[a.max(b) as usize] = a.min(b);
            }
        }
        // A root comes before all others of its body.
        let mut volumes = Vec::new();
        for (index, triangle) in triangles.iter().enumerate() {
            let root = root(&mut parent, index as u32) as usize;
            let corners = triangle.map(|i| positions[i as usize]);
            if root == index {
                self.body.push(self.bodies.len() as u32);
                let [min, max] = [corners[0].to_array(); 2];
                self.bodies.push(Body { min, outward: 0.0, max, unused: 0.0 });
                volumes.push(0.0);
            } else {
                self.body.push(self.body[root]);
            }
            let body = self.body[index] as usize;
            let boxed = &mut self.bodies[body];
            for corner in corners {
                boxed.min = corner.min(boxed.min.into()).to_array();
                boxed.max = corner.max(boxed.max.into()).to_array();
            }
            // Six times the signed volume between the triangle and a corner of the body; which corner does
            // not change the sum.
            let apex = positions[triangles[root][0] as usize].as_dvec3();
            let [a, b, c]: [DVec3; 3] = corners.map(|p| p.as_dvec3() - apex);
            volumes[body] += a.dot(b.cross(c));
        }
        for edge in 0..self.len() {
            let EdgeFault { along, against, .. } = self.directions(edge);
            if (along, against) != (1, 1) {
                let triangle = self.uses[self.first[edge] as usize] >> 1;
                volumes[self.body[triangle as usize] as usize] = 0.0;
            }
        }
        for (body, volume) in self.bodies.iter_mut().zip(volumes) {
            body.outward = if volume == 0.0 { 0.0 } else { volume.signum() as f32 };
        }
    }
}

/// For each vertex the first at the same position. The two zeros are one position.
fn weld(positions: &[Vec3]) -> Vec<u32> {
    let mut seen = HashMap::with_capacity(positions.len());
    let key = |p: &Vec3| p.to_array().map(|x| (x + 0.0).to_bits());
    let first = |(index, p)| *seen.entry(key(p)).or_insert(index as u32);
    positions.iter().enumerate().map(first).collect()
}

fn root(parent: &mut [u32], mut at: u32) -> u32 {
    while parent[at as usize] != at {
        let above = parent[parent[at as usize] as usize];
        parent[at as usize] = above;
        at = above;
    }
    at
}

/// [`Edges`] on the GPU: made once for each mesh, whose vertices may move afterwards (the boxes of `bodies`
/// then no longer hold).
#[derive(Clone, Debug)]
pub struct CasterEdges {
    /// Two `u32` vertex indices an edge.
    pub vertices: wgpu::Buffer,
    /// [`Edges::first`], `u32`.
    pub first: wgpu::Buffer,
    /// [`Edges::uses`], `u32`.
    pub uses: wgpu::Buffer,
    /// [`Edges::body`], `u32`.
    pub body: wgpu::Buffer,
    /// [`Edges::bodies`].
    pub bodies: wgpu::Buffer,
    /// Number of edges.
    pub count: u32,
    /// Number of bodies.
    pub body_count: u32,
    /// Bytes of all buffers.
    pub bytes: u64,
    /// [`Edges::not_manifold`].
    pub not_manifold: Option<EdgeFault>,
    /// [`Edges::not_watertight`].
    pub not_watertight: Option<EdgeFault>,
}

impl CasterEdges {
    /// Uploads `edges`.
    ///
    /// # Errors
    /// More data than the device takes in one buffer.
    pub fn new(gpu: &Gpu, edges: &Edges) -> Result<Self, GpuError> {
        let mut bytes = 0;
        let mut buffer = |label, contents: &[u8]| {
            let limits = gpu.device.limits();
            let limit = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
            let asked = contents.len() as u64;
            if asked > limit {
                return Err(GpuError::Limit { what: "bytes of edges", asked, limit });
            }
            // A buffer may not be empty; zeros that nothing reads.
            let contents = if contents.is_empty() { &[0; 32] } else { contents };
            bytes += contents.len() as u64;
            Ok(gpu.buffer(label, contents, wgpu::BufferUsages::STORAGE))
        };
        Ok(Self {
            vertices: buffer("edge vertices", bytemuck::cast_slice(&edges.vertices))?,
            first: buffer("edge uses: first", bytemuck::cast_slice(&edges.first))?,
            uses: buffer("edge uses", bytemuck::cast_slice(&edges.uses))?,
            body: buffer("triangle bodies", bytemuck::cast_slice(&edges.body))?,
            bodies: buffer("bodies", bytemuck::cast_slice(&edges.bodies))?,
            count: edges.len() as u32,
            body_count: edges.bodies.len() as u32,
            bytes,
            not_manifold: edges.not_manifold,
            not_watertight: edges.not_watertight,
        })
    }
}

#[cfg(test)]
mod tests;
