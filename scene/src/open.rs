//! Opens scenes of many objects by what a user writes.

#[cfg(feature = "json")]
use super::instanced;
use super::instanced::is_saved;
use super::{InstancedScene, SceneError, SceneOptions, builtin, quoted_spec};
use splitplane_float_state::Standard;
use std::ffi::OsStr;
use std::path::Path;

impl InstancedScene {
    /// Whether what a user writes names a scene of many objects: the path of a .json, .gltf or .glb file, of a .scene file, which holds what
    /// was built, or one of the built-in ones.
    pub fn is_named_by(spec: impl AsRef<OsStr>) -> bool {
        let spec = spec.as_ref();
        if let Some(name) = spec.to_str().and_then(|spec| spec.strip_prefix("builtin:")) {
            return builtin::is_instanced(name);
        }
        #[cfg(feature = "gltf")]
        if crate::gltf::is_named_by(Path::new(spec)) {
            return true;
        }
        let ending = Path::new(spec).extension();
        ending.is_some_and(|ending| ending.eq_ignore_ascii_case("json")) || is_saved(spec)
    }

    /// Opens a scene by what a user writes: the path of a .json, .gltf, .glb or .scene file, or `builtin:NAME[:SIZE]`. It is in its first frame.
    ///
    /// # Errors
    /// There is no such scene, or one of its files is broken.
    pub fn open(spec: impl AsRef<OsStr>) -> Result<InstancedScene, SceneError> {
        InstancedScene::open_with(spec, &SceneOptions::default())
    }

    /// As [`InstancedScene::open`], with a say in how files are read.
    ///
    /// # Errors
    /// There is no such scene, or one of its files is broken.
    pub fn open_with(
        spec: impl AsRef<OsStr>,
        options: &SceneOptions,
    ) -> Result<InstancedScene, SceneError> {
        let _state = Standard::set();
        let spec = spec.as_ref();
        if let Some(name) = spec.to_str().and_then(|spec| spec.strip_prefix("builtin:")) {
            return Ok(builtin::open_instanced(name)?);
        }
        #[cfg(feature = "gltf")]
        if crate::gltf::is_named_by(Path::new(spec)) {
            return Ok(crate::gltf::read(Path::new(spec), options)?);
        }
        #[cfg(feature = "json")]
        if is_saved(spec) {
            return Ok(instanced::read_saved(Path::new(spec), options)?);
        }
        #[cfg(feature = "json")]
        if InstancedScene::is_named_by(spec) {
            return Ok(instanced::read(Path::new(spec), options)?);
        }
        let _ = options;
        Err(SceneError::UnknownFormat(quoted_spec(spec)))
    }
}
