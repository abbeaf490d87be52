//! Accessors: typed elements within buffers (section 3.6.2), with every offset checked.

use std::collections::HashMap;
use std::rc::Rc;

use glam::{Vec2, Vec3};
use gltf::json::accessor::{Accessor, ComponentType, Type};
use gltf::json::validation::Checked;
use gltf::json::{Index, Root, buffer};

use super::buffers::Buffers;

/// Most elements of an accessor without bytes of its own, which stands for zeros: 16 million
/// vertices are 200 MB, and no small file can ask for more.
const MAX_IMPLIED: u64 = 1 << 24;

/// Reads accessors; positions, which several primitives may share, once.
pub(super) struct Accessors<'a> {
    root: &'a Root,
    buffers: Buffers<'a>,
    positions: HashMap<usize, Rc<Vec<Vec3>>>,
}

impl<'a> Accessors<'a> {
    pub(super) fn new(root: &'a Root, buffers: Buffers<'a>) -> Self {
        Self { root, buffers, positions: HashMap::new() }
    }

    /// Positions: three floats, or with `KHR_mesh_quantization` three integers.
    pub(super) fn positions(&mut self, index: usize) -> Result<Rc<Vec<Vec3>>, String> {
        if let Some(known) = self.positions.get(&index) {
            return Ok(known.clone());
        }
        let accessor = self.accessor(index)?;
        let component = component(accessor, Type::Vec3, index)?;
        let read = |bytes: &[u8]| {
            let mut p = [0.0; 3];
            for (value, bytes) in p.iter_mut().zip(bytes.chunks_exact(component.size())) {
                *value = coordinate(bytes, component, accessor.normalized);
            }
            Vec3::from_array(p)
        };
        let positions = self.elements(accessor, 3 * component.size(), Vec3::ZERO, &read);
        let positions = Rc::new(positions.map_err(|e| format!("accessor {index}: {e}"))?);
        self.positions.insert(index, positions.clone());
        Ok(positions)
    }

    /// Texture coordinates: two floats, or two normalised unsigned integers.
    pub(super) fn texture_coordinates(&mut self, index: usize) -> Result<Vec<Vec2>, String> {
        let accessor = self.accessor(index)?;
        let component = component(accessor, Type::Vec2, index)?;
        let read = |bytes: &[u8]| {
            let mut uv = [0.0; 2];
            for (value, bytes) in uv.iter_mut().zip(bytes.chunks_exact(component.size())) {
                *value = coordinate(bytes, component, accessor.normalized);
            }
            Vec2::from_array(uv)
        };
        self.elements(accessor, 2 * component.size(), Vec2::ZERO, &read)
            .map_err(|e| format!("accessor {index}: {e}"))
    }

    /// The bytes of a file beside the scene's, or of a data URI.
    pub(super) fn file(&mut self, uri: &str) -> Result<Rc<Vec<u8>>, String> {
        self.buffers.open(uri)
    }

    /// The bytes of a buffer view.
    pub(super) fn view(&mut self, number: usize) -> Result<Rc<Vec<u8>>, String> {
        let view = self.buffer_view(number)?;
        let buffer = self.buffers.get(view.buffer.value())?;
        let start = view.byte_offset.map_or(0, |o| o.0);
        slice(&buffer, start, view.byte_length.0)
            .map(|bytes| Rc::new(bytes.to_vec()))
            .ok_or_else(|| format!("buffer view {number} reaches beyond its buffer"))
    }

    fn buffer_view(&self, number: usize) -> Result<&'a buffer::View, String> {
        self.root.buffer_views.get(number).ok_or_else(|| {
            format!("refers to buffer view {number} of {}", self.root.buffer_views.len())
        })
    }

    /// Vertex indices: unsigned integers of 8, 16 or 32 bits.
    pub(super) fn indices(&mut self, index: usize) -> Result<Vec<u32>, String> {
        let accessor = self.accessor(index)?;
        let component = component(accessor, Type::Scalar, index)?;
        if !matches!(component, ComponentType::U8 | ComponentType::U16 | ComponentType::U32) {
            return Err(format!("accessor {index}: indices must be unsigned integers"));
        }
        self.elements(accessor, component.size(), 0, &unsigned)
            .map_err(|e| format!("accessor {index}: {e}"))
    }

    fn accessor(&self, index: usize) -> Result<&'a Accessor, String> {
        let all = &self.root.accessors;
        all.get(index).ok_or_else(|| format!("refers to accessor {index} of {}", all.len()))
    }

    /// All elements of `size` bytes, the sparse ones (section 3.6.2.3) put over the others.
    fn elements<T: Copy>(
        &mut self,
        accessor: &Accessor,
        size: usize,
        zero: T,
        read: &dyn Fn(&[u8]) -> T,
    ) -> Result<Vec<T>, String> {
        let count = accessor.count.0;
        let mut out = match accessor.buffer_view {
            Some(view) => {
                let offset = accessor.byte_offset.map_or(0, |o| o.0);
                self.strided(view, offset, count, size, read)?
            }
            None if count > MAX_IMPLIED => {
                return Err(format!("has {count} elements without a buffer view"));
            }
            None => vec![zero; count as usize],
        };
        let Some(sparse) = &accessor.sparse else {
            return Ok(out);
        };
        let Checked::Valid(kind) = sparse.indices.component_type else {
            return Err("its sparse indices have an unknown type".to_owned());
        };
        let (count, indices, values) = (sparse.count.0, &sparse.indices, &sparse.values);
        let at = self.strided(
            indices.buffer_view,
            indices.byte_offset.0,
            count,
            kind.0.size(),
            &unsigned,
        )?;
        let values = self.strided(values.buffer_view, values.byte_offset.0, count, size, read)?;
        for (at, value) in at.into_iter().zip(values) {
            let Some(element) = out.get_mut(at as usize) else {
                return Err(format!("its sparse index {at} is beyond its {} elements", out.len()));
            };
            *element = value;
        }
        Ok(out)
    }

    /// `count` elements of `size` bytes from `offset` within a buffer view.
    fn strided<T>(
        &mut self,
        view: Index<buffer::View>,
        offset: u64,
        count: u64,
        size: usize,
        read: &dyn Fn(&[u8]) -> T,
    ) -> Result<Vec<T>, String> {
        let number = view.value();
        let view = self.buffer_view(number)?;
        let buffer = self.buffers.get(view.buffer.value())?;
        let start = view.byte_offset.map_or(0, |o| o.0);
        let bytes = slice(&buffer, start, view.byte_length.0)
            .ok_or_else(|| format!("buffer view {number} reaches beyond its buffer"))?;
        let stride = match view.byte_stride {
            None => size,
            Some(stride) if stride.0 >= size => stride.0,
            Some(stride) => {
                return Err(format!("buffer view {number}: a stride of {} is too short", stride.0));
            }
        };
        if count == 0 {
            return Ok(Vec::new());
        }
        // The last element need not be followed by the rest of its stride.
        (count - 1)
            .checked_mul(stride as u64)
            .and_then(|length| length.checked_add(size as u64))
            .and_then(|length| slice(bytes, offset, length))
            .map(|bytes| bytes.chunks(stride).map(|chunk| read(&chunk[..size])).collect())
            .ok_or_else(|| format!("its {count} elements reach beyond buffer view {number}"))
    }
}

fn slice(bytes: &[u8], start: u64, length: u64) -> Option<&[u8]> {
    let end = usize::try_from(start.checked_add(length)?).ok()?;
    bytes.get(usize::try_from(start).ok()?..end)
}

fn component(accessor: &Accessor, expected: Type, index: usize) -> Result<ComponentType, String> {
    match (&accessor.type_, &accessor.component_type) {
        (Checked::Valid(kind), Checked::Valid(component)) if *kind == expected => Ok(component.0),
        (Checked::Valid(_), Checked::Valid(_)) => {
            Err(format!("accessor {index} must hold elements of type {expected:?}"))
        }
        _ => Err(format!("accessor {index} has an unknown type")),
    }
}

/// A little-endian unsigned integer of one, two or four bytes.
fn unsigned(bytes: &[u8]) -> u32 {
    bytes.iter().rev().fold(0, |value, &byte| value << 8 | u32::from(byte))
}

/// One coordinate. Section 3.11: a normalised integer c of b bits stands for c / (2^b - 1), or
/// max(c / (2^(b-1) - 1), -1) if signed.
fn coordinate(bytes: &[u8], component: ComponentType, normalized: bool) -> f32 {
    let bits = unsigned(bytes);
    let (value, largest) = match component {
        ComponentType::F32 => return f32::from_bits(bits),
        ComponentType::U8 => (bits as f32, f32::from(u8::MAX)),
        ComponentType::U16 => (bits as f32, f32::from(u16::MAX)),
        ComponentType::U32 => (bits as f32, u32::MAX as f32),
        ComponentType::I8 => (f32::from(bits as u8 as i8), f32::from(i8::MAX)),
        ComponentType::I16 => (f32::from(bits as u16 as i16), f32::from(i16::MAX)),
    };
    if normalized { (value / largest).max(-1.0) } else { value }
}
