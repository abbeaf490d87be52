//! The shaders of Antumbra: WESL modules, embedded, and linked on demand to plain WGSL.
//!
//! A root module (say `map/resolve`) imports from *slots* such as `package::layout`, which name no
//! file: [`link`] binds each slot to a concrete module, so that any layout meets any store and any
//! estimator without code for the pair. A slot may also be bound to generated constants, and a binding under the
//! path of a module stands in that module's place.
//!
//! The crate makes no API calls: what becomes of the WGSL is its caller's affair.

use std::borrow::Cow;

use wesl::{ModulePath, VirtualResolver, Wesl};

mod permutations;

pub use permutations::{
    Permutation, blur_target, castano_constants, castano_core, permutations, poisson_constants,
    table_target,
};

// Every module: its path below the package (`common::lookup`) and its source; made by build.rs of the
// files that there are.
include!(concat!(env!("OUT_DIR"), "/modules.rs"));

/// What a slot is bound to.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Binding {
    /// One of [`MODULES`], by its path.
    Module(Cow<'static, str>),
    /// WESL source made for the occasion, usually constants.
    Source(String),
}

/// A slot and what it is bound to.
pub type Slot = (Cow<'static, str>, Binding);

/// Binds `slot` to one of [`MODULES`].
#[must_use]
pub fn module(slot: &'static str, path: &'static str) -> Slot {
    (slot.into(), Binding::Module(path.into()))
}

/// Binds `slot` to generated source.
#[must_use]
pub fn source(slot: &'static str, text: impl Into<String>) -> Slot {
    (slot.into(), Binding::Source(text.into()))
}

/// A module that cannot be linked.
#[derive(Clone, Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LinkError {
    /// No module of that path exists.
    #[error("no shader module `{path}`; the modules are {known}")]
    UnknownModule {
        /// The path asked for.
        path: String,
        /// All paths there are.
        known: String,
    },
    /// The linker found a fault, for example an import that no slot provides.
    #[error("shader `{root}` cannot be linked: {reason}")]
    Link {
        /// The root module.
        root: String,
        /// The linker's own words.
        reason: String,
    },
}

/// Links the module at `root` (`map::resolve`) to plain WGSL, with `slots` bound.
///
/// Only what the root's entry points reach is kept. Names of the root are unchanged; others are
/// prefixed with their module's path.
///
/// # Errors
/// An unknown module path, or an import that nothing provides.
pub fn link(root: &str, slots: &[Slot]) -> Result<String, LinkError> {
    link_keeping(root, find(root)?, slots, None)
}

/// As [`link`], but keeps the named declarations of the root instead of its entry points: a library
/// of functions for another shader.
///
/// So a forward renderer gets shadows into its own fragment shader:
///
/// ```
/// use antumbra_shaders::{link_functions, module, source};
///
/// let slots = [
///     module("layout", "map::layout_cube"),
///     module("store", "common::depth_map"),
///     module("estimator", "map::nearest"),
///     // Where this renderer keeps the light's views.
///     source("map::views", "import package::common::lookup::{ShadowView};
///         @group(1) @binding(0) var<storage, read> views: array<ShadowView>;
///         fn view_at(i: i32) -> ShadowView { return views[i]; }"),
/// ];
/// // In its fragment shader: shadow(map, compare, view_of(p), p, n, 0.0, pixel).
/// let library = link_functions("map::shadow", &slots, &["view_of", "shadow"])?;
/// # assert!(library.contains("fn shadow("), "the function keeps its name");
/// # Ok::<(), antumbra_shaders::LinkError>(())
/// ```
///
/// # Errors
/// As [`link`].
pub fn link_functions(root: &str, slots: &[Slot], keep: &[&str]) -> Result<String, LinkError> {
    let keep = keep.iter().map(|&k| k.to_owned()).collect();
    link_keeping(root, find(root)?, slots, Some(keep))
}

/// As [`link`], for a root that is not among [`MODULES`]: WESL `text`, which may import from any of
/// them (`import package::map::shadow::{shadow};`). `name` stands in messages; it must not be the path
/// of a module.
///
/// # Errors
/// As [`link`].
pub fn link_source(name: &str, text: &str, slots: &[Slot]) -> Result<String, LinkError> {
    link_keeping(name, text, slots, None)
}

fn link_keeping(
    root: &str,
    text: &str,
    slots: &[Slot],
    keep: Option<Vec<String>>,
) -> Result<String, LinkError> {
    let mut resolver = VirtualResolver::new();
    for (path, text) in MODULES {
        resolver.add_module(module_path(root, path)?, Cow::Borrowed(*text));
    }
    resolver.add_module(module_path(root, root)?, Cow::Borrowed(text));
    // Also in the place of modules, where a slot has the path of one.
    for (slot, binding) in slots {
        let text = match binding {
            Binding::Module(path) => Cow::Borrowed(find(path)?),
            Binding::Source(text) => Cow::Owned(text.clone()),
        };
        resolver.add_module(module_path(root, slot)?, text);
    }
    let mut linker = Wesl::new_barebones().set_custom_resolver(resolver);
    linker.use_imports(true).use_stripping(true).set_mangler(wesl::ManglerKind::Escape);
    match keep {
        Some(keep) => linker.keep_declarations(keep),
        None => linker.keep_all_entrypoints(),
    };
    let linked = linker
        .compile(&module_path(root, root)?)
        .map_err(|e| LinkError::Link { root: root.to_owned(), reason: e.to_string() })?;
    Ok(linked.to_string())
}

fn find(path: &str) -> Result<&'static str, LinkError> {
    MODULES.iter().find(|(name, _)| *name == path).map(|(_, text)| *text).ok_or_else(|| {
        let known: Vec<_> = MODULES.iter().map(|(name, _)| *name).collect();
        LinkError::UnknownModule { path: path.to_owned(), known: known.join(", ") }
    })
}

fn module_path(root: &str, path: &str) -> Result<ModulePath, LinkError> {
    format!("package::{path}")
        .parse()
        .map_err(|e| LinkError::Link { root: root.to_owned(), reason: format!("`{path}`: {e}") })
}
