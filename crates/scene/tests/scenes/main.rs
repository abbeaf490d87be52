//! Scene files as users bring them, sound and broken, and placement from a scene's bounds.

mod broken;
mod gltf;
mod gltf_alpha;
mod obj;
mod placement;
mod toml;

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use antumbra_scene::{LoadError, LoadOptions, Repairs, Scene, load};

/// A folder of its own for a test, removed afterwards.
struct Folder(PathBuf);

impl Folder {
    fn new() -> Self {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let name = format!("antumbra-scene-{}-{number}", std::process::id());
        let path = std::env::temp_dir().join(name);
        std::fs::create_dir_all(&path).expect("the temporary folder can be written");
        Self(path)
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.join(name);
        std::fs::write(&path, bytes).expect("the temporary folder can be written");
        path
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // A folder left behind harms nobody.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn read(path: &Path) -> Result<(Scene, Repairs), LoadError> {
    load(path, &LoadOptions::default())
}

/// Loads a single file of that name and content.
fn read_as(name: &str, bytes: impl AsRef<[u8]>) -> Result<(Scene, Repairs), LoadError> {
    read(&Folder::new().write(name, bytes))
}

/// The message of the error, which must name the file.
fn fault_of(name: &str, bytes: impl AsRef<[u8]>) -> String {
    match read_as(name, bytes) {
        Ok(_) => panic!("{name} was loaded in spite of its fault"),
        Err(error) => {
            let message = error.to_string();
            assert!(message.contains(name), "the message does not name the file: {message}");
            message
        }
    }
}
