//! The bytes behind a glTF file's buffers: its binary chunk, other files, data URIs.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use gltf::json::Root;

use crate::load::{base64, read_file};

/// Reads buffers when they are first asked for, and each file once.
pub(super) struct Buffers<'a> {
    path: &'a Path,
    root: &'a Root,
    blob: Option<Rc<Vec<u8>>>,
    known: HashMap<usize, Rc<Vec<u8>>>,
    files: HashMap<PathBuf, Rc<Vec<u8>>>,
}

impl<'a> Buffers<'a> {
    pub(super) fn new(path: &'a Path, root: &'a Root, blob: Option<Vec<u8>>) -> Self {
        let (known, files) = Default::default();
        Self { path, root, blob: blob.map(Rc::new), known, files }
    }

    /// The bytes of a buffer, at least as many as the file states.
    pub(super) fn get(&mut self, index: usize) -> Result<Rc<Vec<u8>>, String> {
        if let Some(known) = self.known.get(&index) {
            return Ok(known.clone());
        }
        let buffer = (self.root.buffers.get(index))
            .ok_or_else(|| format!("refers to buffer {index} of {}", self.root.buffers.len()))?;
        let bytes = match &buffer.uri {
            Some(uri) => self.open(uri).map_err(|reason| format!("buffer {index}: {reason}"))?,
            // Section 4.4.3: the binary chunk is buffer 0.
            None if index == 0 => self.blob.clone().ok_or("its binary chunk is missing")?,
            None => return Err(format!("buffer {index} has no uri")),
        };
        let (stated, there) = (buffer.byte_length.0, bytes.len());
        if (there as u64) < stated {
            return Err(format!("buffer {index} is cut off: {there} of {stated} bytes are there"));
        }
        self.known.insert(index, bytes.clone());
        Ok(bytes)
    }

    /// The bytes behind a URI.
    pub(super) fn open(&mut self, uri: &str) -> Result<Rc<Vec<u8>>, String> {
        if let Some(data) = uri.strip_prefix("data:") {
            let (_, text) = data.split_once(";base64,").ok_or("its data URI is not base 64")?;
            return base64::decode(text)
                .map(Rc::new)
                .ok_or_else(|| "its data URI is not valid base 64".to_owned());
        }
        if uri.contains("://") {
            return Err(format!("`{uri}` is not a relative path, the only kind that is followed"));
        }
        let name = percent_decode(uri).ok_or_else(|| format!("`{uri}` is no valid path"))?;
        let file = self.path.parent().unwrap_or(Path::new("")).join(name);
        if let Some(known) = self.files.get(&file) {
            return Ok(known.clone());
        }
        let bytes = Rc::new(read_file(&file).map_err(|e| e.to_string())?);
        self.files.insert(file, bytes.clone());
        Ok(bytes)
    }
}

/// Section 2.8: reserved characters of a path are percent-encoded.
fn percent_decode(uri: &str) -> Option<String> {
    let mut out = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let [first, tail @ ..] = rest {
        rest = tail;
        if *first != b'%' {
            out.push(*first);
            continue;
        }
        let (digits, tail) = tail.split_at_checked(2)?;
        let digit = |d: u8| char::from(d).to_digit(16);
        out.push((16 * digit(digits[0])? + digit(digits[1])?) as u8);
        rest = tail;
    }
    String::from_utf8(out).ok()
}
