//! Backends by name.

use std::sync::{Arc, Mutex};

use numpy::PyReadonlyArray2;
use pyo3::prelude::*;
use splitplane::backend::Engine;
use splitplane::core::tree::file;
use splitplane::{Backend, BackendKind, Mesh, OpenOptions, Preset};

use crate::arrays::rows;
use crate::failure::Failure;

/// A backend, and why it is this one.
pub(crate) struct Opened {
    pub engine: Arc<Engine>,
    /// `cpu` or `wgpu`.
    pub name: String,
    pub reason: String,
    /// The process that opened it: a device does not outlive a fork.
    process: u32,
}

impl Opened {
    pub(crate) fn backend(&self) -> &dyn Backend {
        self.engine.as_backend()
    }

    pub(crate) fn is_cpu(&self) -> bool {
        self.name == "cpu"
    }

    /// Another backend of the same kind for the CPU, without the memory that this one keeps.
    pub(crate) fn anew(&self) -> Result<Opened, Failure> {
        let fresh = BackendKind::Cpu.open_engine(&OpenOptions::default())?;
        let (name, reason) = (self.name.clone(), self.reason.clone());
        Ok(Opened { engine: Arc::new(fresh.engine), name, reason, process: self.process })
    }

    /// # Errors
    /// A device that another process opened.
    pub(crate) fn check_process(&self) -> Result<(), Failure> {
        match self.is_cpu() || self.process == std::process::id() {
            true => Ok(()),
            false => {
                let text =
                    "the device was opened by another process, from which this one was forked";
                Err(Failure::new("DeviceError", text))
            }
        }
    }
}

/// What was asked for, and what that gave. To open a device takes long, so it is done once.
type Known = (BackendKind, Option<String>, bool, Arc<Opened>);
static KNOWN: Mutex<Vec<Known>> = Mutex::new(Vec::new());

/// Opens a backend, or finds it open. One for the CPU is always new: it keeps memory of builds, which is to go with its tree.
pub(crate) fn open(
    py: Python<'_>,
    name: &str,
    adapter: Option<&str>,
    preset: Preset,
) -> PyResult<Arc<Opened>> {
    let kind: BackendKind =
        name.parse().map_err(|error: splitplane::backend::UnknownBackend| {
            Failure::new("ConfigError", error.to_string())
        })?;
    let (process, offline) = (std::process::id(), preset.planes().is_none());
    let known = {
        let known = KNOWN.lock().unwrap_or_else(|broken| broken.into_inner());
        let same = |(own, of, off, opened): &&Known| {
            *own == kind && of.as_deref() == adapter && *off == offline && opened.process == process
        };
        known.iter().find(same).map(|(_, _, _, opened)| Arc::clone(opened))
    };
    match known {
        Some(opened) if !opened.is_cpu() => return Ok(opened),
        // `auto` found no device before.
        Some(opened) => return Ok(Arc::new(opened.anew()?)),
        None => {}
    }
    let options =
        OpenOptions { adapter: adapter.map(str::to_owned), preset, ..OpenOptions::default() };
    let found = py.detach(|| kind.open_engine(&options)).map_err(Failure::from)?;
    let name = found.engine.as_backend().describe().name;
    let opened =
        Arc::new(Opened { engine: Arc::new(found.engine), name, reason: found.reason, process });
    if kind != BackendKind::Cpu {
        let mut known = KNOWN.lock().unwrap_or_else(|broken| broken.into_inner());
        known.push((kind, options.adapter, offline, Arc::clone(&opened)));
    }
    Ok(opened)
}

/// What a backend is: (name, adapter, threads, detail, reason).
#[pyfunction]
#[pyo3(signature = (name, adapter=None))]
#[expect(clippy::type_complexity, reason = "a tuple for Python")]
pub(crate) fn describe(
    py: Python<'_>,
    name: &str,
    adapter: Option<&str>,
) -> PyResult<(String, Option<String>, Option<usize>, String, String)> {
    let opened = open(py, name, adapter, Preset::Fast)?;
    let info = opened.backend().describe();
    Ok((info.name, info.adapter, info.threads, info.detail, opened.reason.clone()))
}

/// The digest of a mesh, as tree files have it.
#[pyfunction]
pub(crate) fn mesh_digest(
    vertices: PyReadonlyArray2<'_, f32>,
    faces: PyReadonlyArray2<'_, u32>,
) -> PyResult<String> {
    let (vertices, faces) = (rows(&vertices, "vertices")?, rows(&faces, "faces")?);
    let mesh = Mesh::indexed(vertices, faces).map_err(Failure::from)?;
    Ok(file::mesh_digest(&mesh).to_string())
}
