//! Plain scene data, without a GPU: meshes, lights, cameras, scene files and generated hard cases.
//!
//! Conventions: right-handed world, y up, metres, angles in radians. Transforms, cameras and lights
//! are `f64`; mesh vertices are `f32` in the space of their mesh. [`Scene::triangles`] brings
//! everything into one `f32` triangle list relative to a chosen origin, so that a scene far from
//! the world's origin loses no precision.
//!
//! ```
//! use antumbra_scene::{LightKind, LoadOptions, generate, load};
//!
//! // From a file, with whatever was repaired in it ...
//! match load("bunny.glb".as_ref(), &LoadOptions::default()) {
//!     Ok((scene, repairs)) => println!("{} triangles; {repairs}", scene.triangle_count()),
//!     Err(error) => println!("{error}"), // names the file and its fault
//! }
//!
//! // ... or generated, with a camera and lights of its own or placed from its bounds.
//! let mut scene = generate::by_name("tree").ok_or("no such scene")?;
//! scene.add_ground();
//! let camera = scene.camera_or_framing();
//! let light = scene.light_or_placed(LightKind::Disc);
//! let triangles = scene.triangles(scene.origin())?;
//! # assert!(camera.near > 0.0 && !light.is_hard(), "a soft light");
//! # assert_eq!(triangles.triangles.len(), scene.triangle_count(), "all triangles");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod camera;
mod cutout;
mod emission;
mod error;
mod frame;
pub mod generate;
mod light;
mod load;
mod mesh;
mod opacity;
mod scene;

pub use camera::Camera;
pub use cutout::{AlphaMap, CutInstance, Cutout, Cutouts, Wrap};
pub use emission::{Emission, EmissionError};
pub use error::{LoadError, MeshError};
pub use light::{Light, LightKind};
pub use load::{LoadOptions, REACH, Repairs, load};
pub use mesh::{Bounds, Mesh};
pub use opacity::{Opacities, Opacity, TranslucentInstance};
pub use scene::{Instance, Scene, Triangles};
