//! What can be wrong with geometry and files.

use std::path::PathBuf;

/// A fault in mesh data.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// A vertex has a coordinate that is infinite or not a number.
    #[error(
        "mesh `{mesh}`: vertex {vertex} is not finite; remove or repair it before building a scene"
    )]
    NonFinite {
        /// The mesh's name.
        mesh: String,
        /// Index of the first such vertex.
        vertex: usize,
    },
    /// A triangle refers to a vertex that does not exist.
    #[error(
        "mesh `{mesh}`: triangle {triangle} refers to a vertex beyond the {vertices} there are"
    )]
    IndexOutOfRange {
        /// The mesh's name.
        mesh: String,
        /// Index of the first such triangle.
        triangle: usize,
        /// Number of vertices of the mesh.
        vertices: usize,
    },
    /// A cut-out does not fit its mesh.
    #[error("mesh `{mesh}`: its cut-out {fault}")]
    Cutout {
        /// The mesh's name.
        mesh: String,
        /// What it has or lacks.
        fault: &'static str,
    },
    /// A cut-out is that of a mesh that does not exist.
    #[error("a cut-out is that of mesh {mesh} of {meshes}")]
    CutoutOfNothing {
        /// The mesh index it gives.
        mesh: usize,
        /// Number of meshes of the scene.
        meshes: usize,
    },
    /// An opacity does not fit its mesh.
    #[error("mesh `{mesh}`: its opacity {fault}")]
    Opacity {
        /// The mesh's name.
        mesh: String,
        /// What it has or lacks.
        fault: &'static str,
    },
    /// An opacity is that of a mesh that does not exist.
    #[error("an opacity is that of mesh {mesh} of {meshes}")]
    OpacityOfNothing {
        /// The mesh index it gives.
        mesh: usize,
        /// Number of meshes of the scene.
        meshes: usize,
    },
    /// An instance refers to a mesh that does not exist.
    #[error("instance `{instance}` refers to mesh {mesh} of {meshes}")]
    NoSuchMesh {
        /// The instance's name.
        instance: String,
        /// The mesh index it gives.
        mesh: usize,
        /// Number of meshes of the scene.
        meshes: usize,
    },
    /// A vertex lies too far out, in the world or from the chosen origin, to compute with.
    #[error(
        "instance `{instance}`: its transform takes vertex {vertex} too far out; \
         use metres, and an origin near the scene"
    )]
    OutOfReach {
        /// The instance's name.
        instance: String,
        /// Index of the first such vertex within its mesh.
        vertex: usize,
    },
    /// More vertices than 32-bit indices can address.
    #[error("the scene has more than 4294967295 vertices; split it or reduce its detail")]
    TooLarge,
}

/// A scene file that cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LoadError {
    /// The file cannot be read or understood.
    #[error("{path}: {reason}", path = path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What is wrong with it, and where.
        reason: String,
    },
    /// The file's ending names no format that is read here.
    #[error("{path}: unknown kind of scene file; use .glb, .gltf, .obj or .toml", path = path.display())]
    UnknownFormat {
        /// The file.
        path: PathBuf,
    },
    /// The file was read but holds no triangle.
    #[error("{path}: holds no triangle{hint}", path = path.display())]
    Empty {
        /// The file.
        path: PathBuf,
        /// What was found instead, or an empty string.
        hint: String,
    },
    /// The file asks for more triangles than allowed, counted over all instances.
    #[error(
        "{path}: asks for more than {limit} triangles over all instances; \
         reduce its detail or raise `LoadOptions::max_triangles`",
        path = path.display()
    )]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// The limit, [`LoadOptions::max_triangles`](crate::LoadOptions::max_triangles).
        limit: usize,
    },
    /// The file's geometry is faulty.
    #[error("{path}: {source}", path = path.display())]
    Mesh {
        /// The file.
        path: PathBuf,
        /// The fault.
        source: MeshError,
    },
}
