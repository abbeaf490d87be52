//! Wavefront OBJ: positions and faces, everything else passed over.

use std::path::Path;

use glam::{DAffine3, Vec3};

use super::clean::{Source, clean};
use super::{LoadOptions, Repairs, read_file, stem, unreadable};
use crate::{LoadError, Scene};

pub(super) fn load(
    path: &Path,
    options: &LoadOptions,
    repairs: &mut Repairs,
) -> Result<Scene, LoadError> {
    let bytes = read_file(path)?;
    // Names and comments come in any encoding, and none of them matters here.
    let text = String::from_utf8_lossy(&bytes);
    let file = parse(&text, repairs).map_err(|reason| unreadable(path, reason))?;
    let source = if options.weld { Source::Welded } else { Source::Separate };
    let mut scene = Scene::default();
    for object in file.objects {
        let name = object.name.unwrap_or_else(|| stem(path));
        let mesh = clean(name, source(&file.positions), object.triangles.into_iter(), repairs)
            .map_err(|source| LoadError::Mesh { path: path.to_owned(), source })?;
        if !mesh.triangles.is_empty() {
            scene.add(mesh, DAffine3::IDENTITY);
        }
    }
    Ok(scene)
}

#[derive(Default)]
struct Object {
    name: Option<String>,
    triangles: Vec<[u32; 3]>,
}

#[derive(Default)]
struct File {
    positions: Vec<Vec3>,
    objects: Vec<Object>,
}

fn parse(text: &str, repairs: &mut Repairs) -> Result<File, String> {
    let mut file = File::default();
    let mut object = Object::default();
    let mut lines = text.lines().enumerate();
    while let Some((number, line)) = lines.next() {
        let mut line = std::borrow::Cow::from(line);
        // A backslash at the end continues the line.
        while let Some(start) = line.trim_end().strip_suffix('\\') {
            let Some((_, next)) = lines.next() else {
                line = start.to_owned().into();
                break;
            };
            line = format!("{start} {next}").into();
        }
        let mut words = line.split_whitespace();
        let at_line = |fault: String| format!("line {}: {fault}", number + 1);
        match words.next() {
            Some("v") => file.positions.push(position(words).map_err(at_line)?),
            Some("f") => {
                let known = file.positions.len();
                if face(words, known, &mut object.triangles).map_err(at_line)? < 3 {
                    repairs.skipped_primitives += 1;
                }
            }
            Some("l" | "p") => repairs.skipped_primitives += 1,
            Some("o") => {
                file.objects.push(std::mem::take(&mut object));
                object.name = words.next().map(str::to_owned);
            }
            _ => {}
        }
    }
    file.objects.push(object);
    Ok(file)
}

/// `x y z`, `x y z w` or `x y z r g b`. The weight w is that of rational curves; as every other
/// reader of polygons, this one passes over it and over colours.
fn position<'a>(mut words: impl Iterator<Item = &'a str>) -> Result<Vec3, String> {
    let mut p = [0.0; 3];
    for (value, axis) in p.iter_mut().zip("xyz".chars()) {
        let word = words.next().ok_or_else(|| format!("the vertex has no {axis} coordinate"))?;
        *value = word.parse().map_err(|_| format!("`{word}` is no coordinate"))?;
    }
    Ok(Vec3::from_array(p))
}

/// Appends the fan around the face's first corner; returns the number of corners. A corner is
/// `v`, `v/vt`, `v//vn` or `v/vt/vn`, counted from 1, or from the last vertex so far with -1.
fn face<'a>(
    words: impl Iterator<Item = &'a str>,
    known: usize,
    triangles: &mut Vec<[u32; 3]>,
) -> Result<usize, String> {
    let mut corners = (None, None);
    let mut count = 0;
    for word in words {
        if word.starts_with('#') {
            break;
        }
        let digits = word.split('/').next().unwrap_or_default();
        let given: i64 = digits.parse().map_err(|_| format!("`{word}` is no corner of a face"))?;
        let index = if given < 0 { given + known as i64 } else { given - 1 };
        // Vertices may follow their faces, so only what no file can contain is refused here.
        let index = u32::try_from(index)
            .map_err(|_| format!("corner `{word}` of a face refers to no vertex"))?;
        count += 1;
        corners = match corners {
            (None, _) => (Some(index), None),
            (Some(first), None) => (Some(first), Some(index)),
            (Some(first), Some(last)) => {
                triangles.push([first, last, index]);
                (Some(first), Some(index))
            }
        };
    }
    Ok(count)
}
