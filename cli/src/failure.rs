//! Why a run ends before it is done: a sentence and an exit code.

use splitplane::objects::{SceneBuildError, SceneError as ObjectsError, SceneWriteError};
use splitplane::picture::PictureError;
use splitplane::points::PointBuildError;
use splitplane::render::{EnvironmentMapError, PlanError, RenderError};
use splitplane::scene::environment::{EnvironmentError, EnvironmentProblem};
use splitplane::scene::instanced::{InstancedError, SceneFileProblem};
use splitplane::scene::obj::{ObjError, ObjProblem};
use splitplane::scene::{AnimationError, MeshFileError, MeshFileProblem, SceneError};
use splitplane::tracer::TracerError;
use splitplane::{BuildError, DeviceError, MeshError, OpenError, QueryError};
#[cfg(feature = "measure")]
use splitplane_measure::paper::ReportError;
#[cfg(feature = "measure")]
use splitplane_measure::trade::TradeError;
use std::process::ExitCode;

const FAILED_CHECK: u8 = 1;
const USAGE: u8 = 2;
const FILE: u8 = 3;
const LIMIT: u8 = 4;
const NO_GPU: u8 = 5;
const DEVICE: u8 = 6;
pub(super) const CANCELLED: u8 = 7;
pub(super) const BUG: u8 = 70;

/// A sentence that says what is wrong and what to do, and the code the program ends with.
#[derive(Debug)]
pub struct Failure {
    message: String,
    code: u8,
}

impl Failure {
    pub(super) fn failed_check(message: impl Into<String>) -> Failure {
        Failure { message: message.into(), code: FAILED_CHECK }
    }

    pub(super) fn usage(message: impl Into<String>) -> Failure {
        Failure { message: message.into(), code: USAGE }
    }

    pub(super) fn file(message: impl Into<String>) -> Failure {
        Failure { message: message.into(), code: FILE }
    }

    pub(super) fn limit(message: impl Into<String>) -> Failure {
        Failure { message: message.into(), code: LIMIT }
    }

    pub(super) fn cancelled(message: impl Into<String>) -> Failure {
        Failure { message: message.into(), code: CANCELLED }
    }

    /// What cannot be, whatever the user does.
    pub(super) fn bug(message: impl Into<String>) -> Failure {
        Failure { message: message.into(), code: BUG }
    }

    /// Whoever reads our output went away: nothing is wrong, and there is nobody to tell.
    pub(super) fn nobody_listens() -> Failure {
        Failure { message: String::new(), code: 0 }
    }

    /// The sentence; empty where there is nobody to tell.
    pub fn message(&self) -> &str {
        &self.message
    }

    /// The exit code as a number.
    pub fn number(&self) -> u8 {
        self.code
    }

    pub(super) fn code(&self) -> ExitCode {
        ExitCode::from(self.number())
    }
}

impl From<SceneError> for Failure {
    fn from(error: SceneError) -> Failure {
        match &error {
            SceneError::Builtin(_) => Failure::usage(error.to_string()),
            SceneError::UnknownFormat(_) => {
                Failure::usage(format!("{error}; `splitplane --help` lists the verbs"))
            }
            SceneError::Obj(obj) => from_obj(obj, error.to_string()),
            SceneError::MeshFile(file) => from_mesh_file(file, error.to_string()),
            SceneError::ManyObjects(_) => Failure::usage(error.to_string()),
            SceneError::File(file) => match &*file.problem {
                SceneFileProblem::Obj(obj) => from_obj(obj, error.to_string()),
                problem if problem.is_limit() => Failure::limit(error.to_string()),
                _ => Failure::file(error.to_string()),
            },
            _ => Failure::file(error.to_string()),
        }
    }
}

/// A run that an OBJ file ends, with the option that may help.
fn from_obj(error: &ObjError, message: String) -> Failure {
    match error.problem {
        ObjProblem::TooLong { .. } => Failure::limit(message + "; --max-file allows more"),
        ref problem if problem.is_limit() => Failure::limit(message),
        _ => Failure::file(message),
    }
}

/// A run that a file of another format ends, with the option that may help.
fn from_mesh_file(error: &MeshFileError, message: String) -> Failure {
    match error.problem {
        MeshFileProblem::TooLong { .. } => Failure::limit(message + "; --max-file allows more"),
        ref problem if problem.is_limit() => Failure::limit(message),
        _ => Failure::file(message),
    }
}

impl From<EnvironmentError> for Failure {
    fn from(error: EnvironmentError) -> Failure {
        let message = error.to_string();
        match &error.problem {
            EnvironmentProblem::TooLong(_) => Failure::limit(message + "; --max-file allows more"),
            EnvironmentProblem::TooLarge { .. } => {
                Failure::limit(message + "; --max-texture allows more")
            }
            problem if problem.is_limit() => Failure::limit(message),
            EnvironmentProblem::Map(
                EnvironmentMapError::Strength { .. } | EnvironmentMapError::Rotation { .. },
            ) => Failure::usage(message),
            _ => Failure::file(message),
        }
    }
}

impl From<InstancedError> for Failure {
    fn from(error: InstancedError) -> Failure {
        match error {
            InstancedError::Objects(ObjectsError::OutOfMemory { .. }) => {
                Failure::limit(error.to_string())
            }
            error => Failure::file(error.to_string()),
        }
    }
}

impl From<SceneBuildError> for Failure {
    fn from(error: SceneBuildError) -> Failure {
        let code = match &error {
            SceneBuildError::Cancelled { .. } => CANCELLED,
            SceneBuildError::OutOfMemory { .. } => LIMIT,
            SceneBuildError::Geometry { error, .. } => Failure::from(error.clone()).code,
            SceneBuildError::Device(error) => Failure::from(BuildError::Device(error.clone())).code,
            _ => FILE,
        };
        Failure { message: error.to_string(), code }
    }
}

impl From<SceneWriteError> for Failure {
    fn from(error: SceneWriteError) -> Failure {
        match error {
            SceneWriteError::Build(error) => error.into(),
            error => Failure::file(error.to_string()),
        }
    }
}

impl From<PointBuildError> for Failure {
    fn from(error: PointBuildError) -> Failure {
        let code = match &error {
            PointBuildError::Cancelled { .. } => CANCELLED,
            PointBuildError::TooManyPoints { .. } | PointBuildError::OutOfMemory { .. } => LIMIT,
            PointBuildError::NotBitwise { .. } => DEVICE,
            _ => BUG,
        };
        Failure { message: error.to_string(), code }
    }
}

impl From<MeshError> for Failure {
    fn from(error: MeshError) -> Failure {
        let code = match error {
            MeshError::TooManyTriangles { .. } => LIMIT,
            _ => FILE,
        };
        Failure { message: error.to_string(), code }
    }
}

impl From<OpenError> for Failure {
    fn from(error: OpenError) -> Failure {
        let code = match error {
            OpenError::NoGpuBackend
            | OpenError::NoAdapter
            | OpenError::WrongAdapter { .. }
            | OpenError::Unusable { .. }
            | OpenError::Structural { .. } => NO_GPU,
            #[cfg(feature = "wgpu")]
            OpenError::DriverLimit { .. } => DEVICE,
            OpenError::DeviceFailed { .. } => DEVICE,
            _ => USAGE,
        };
        let hint = match error {
            OpenError::Structural { .. } => "; --allow-structural allows it",
            _ => "",
        };
        Failure { message: format!("{error}{hint}"), code }
    }
}

impl From<BuildError> for Failure {
    fn from(error: BuildError) -> Failure {
        let code = match error {
            BuildError::Config(_) | BuildError::PresetNotOnDevice { .. } => USAGE,
            BuildError::Cancelled { .. } => CANCELLED,
            BuildError::OutOfMemory { .. } | BuildError::TooLarge { .. } => LIMIT,
            BuildError::WrongMesh { .. } | BuildError::InvalidMesh { .. } => FILE,
            BuildError::Device(ref error) => of_device(error),
            _ => BUG,
        };
        Failure { message: error.to_string(), code }
    }
}

/// The exit code of what went wrong on a device.
fn of_device(error: &DeviceError) -> u8 {
    match error {
        DeviceError::Limit { .. } | DeviceError::OutOfMemory { .. } => LIMIT,
        _ => DEVICE,
    }
}

impl From<QueryError> for Failure {
    fn from(error: QueryError) -> Failure {
        let code = match error {
            QueryError::LengthMismatch { .. } => BUG,
            QueryError::Cancelled { .. } => CANCELLED,
            QueryError::OutOfMemory { .. } => LIMIT,
            QueryError::Device(ref error) => of_device(error),
            _ => BUG,
        };
        Failure { message: error.to_string(), code }
    }
}

impl From<PictureError> for Failure {
    fn from(error: PictureError) -> Failure {
        let code = match error {
            PictureError::Delay { .. }
            | PictureError::Dimensions { .. }
            | PictureError::Repeated(_) => USAGE,
            PictureError::Write { .. } => FILE,
            _ => BUG,
        };
        Failure { message: error.to_string(), code }
    }
}

impl From<AnimationError> for Failure {
    fn from(error: AnimationError) -> Failure {
        match error {
            AnimationError::Scene(error) => error.into(),
            AnimationError::NoFrames(_) | AnimationError::NotFrames(_) => {
                Failure::usage(error.to_string())
            }
            AnimationError::Frame { error: ref obj, .. } => from_obj(obj, error.to_string()),
            error => Failure::file(error.to_string()),
        }
    }
}

impl From<TracerError> for Failure {
    fn from(error: TracerError) -> Failure {
        match error {
            TracerError::Build(error) => error.into(),
            TracerError::Scene(error) => error.into(),
            TracerError::Render(RenderError::Query(error)) => error.into(),
            TracerError::Render(error) => {
                let code = match &error {
                    RenderError::Plan(PlanError::TooLarge { .. })
                    | RenderError::PixelTooDeep { .. }
                    | RenderError::TooManyPhotons { .. }
                    | RenderError::Appearance(_) => LIMIT,
                    RenderError::Plan(_) => USAGE,
                    RenderError::PhotonMap(PointBuildError::Cancelled { .. }) => CANCELLED,
                    RenderError::PhotonMap(PointBuildError::Device(error)) => of_device(error),
                    RenderError::PhotonMap(_) => LIMIT,
                    #[cfg(feature = "wgpu")]
                    RenderError::ExactOnDevice => USAGE,
                    #[cfg(feature = "wgpu")]
                    RenderError::Gpu(error) => gpu_code(error),
                    _ => BUG,
                };
                Failure { message: error.to_string(), code }
            }
            error @ TracerError::Unfinished { .. } => {
                Failure { message: error.to_string(), code: DEVICE }
            }
            other => Failure { message: other.to_string(), code: BUG },
        }
    }
}

#[cfg(feature = "wgpu")]
fn gpu_code(error: &splitplane::gpu::GpuError) -> u8 {
    use splitplane::gpu::GpuError;
    match error {
        GpuError::Limit { .. } | GpuError::OutOfMemory { .. } => LIMIT,
        _ => DEVICE,
    }
}

#[cfg(feature = "measure")]
impl From<ReportError> for Failure {
    fn from(error: ReportError) -> Failure {
        match error {
            ReportError::Scene(error) => error.into(),
            ReportError::Open(error) => error.into(),
            ReportError::Mesh(error) => error.into(),
            ReportError::Tracer(error) => error.into(),
            ReportError::Query(error) => error.into(),
            ReportError::Picture(error) => error.into(),
            ReportError::Threads { .. } => Failure::usage(error.to_string()),
            ReportError::Points(error) => error.into(),
            ReportError::Animation(error) => error.into(),
            ReportError::Empty(_) => Failure::file(error.to_string()),
            other => Failure { message: other.to_string(), code: BUG },
        }
    }
}

#[cfg(feature = "measure")]
impl From<TradeError> for Failure {
    fn from(error: TradeError) -> Failure {
        match error {
            TradeError::Report(error) => error.into(),
            TradeError::Mesh(error) => error.into(),
            TradeError::Query(error) => error.into(),
            TradeError::Picture(error) => error.into(),
            TradeError::Build { setting, error } => {
                let Failure { message, code } = error.into();
                Failure { message: format!("{setting}: {message}"), code }
            }
            TradeError::Old { .. } => Failure::file(error.to_string()),
            other => Failure { message: other.to_string(), code: BUG },
        }
    }
}

#[cfg(feature = "wgpu")]
impl From<splitplane::parity::ParityError> for Failure {
    fn from(error: splitplane::parity::ParityError) -> Failure {
        use splitplane::parity::ParityError;
        match error {
            ParityError::Build(error) => error.into(),
            ParityError::Query(error) => error.into(),
            other => Failure { message: other.to_string(), code: BUG },
        }
    }
}

#[cfg(feature = "viewer")]
impl From<splitplane_viewer::ViewerError> for Failure {
    fn from(error: splitplane_viewer::ViewerError) -> Failure {
        use splitplane_viewer::ViewerError;
        let code = match error {
            ViewerError::Adapter(error) => return error.into(),
            ViewerError::Frame(error) => return error.into(),
            ViewerError::NoDisplay(_) | ViewerError::Window(_) | ViewerError::NoSurface(_) => {
                NO_GPU
            }
            ViewerError::DeviceLost(_) | ViewerError::Device(_) => DEVICE,
            ViewerError::Screenshot(_) => FILE,
            _ => BUG,
        };
        let hint = match error {
            ViewerError::NoDisplay(_) => "; `splitplane render` needs none",
            _ => "",
        };
        Failure { message: format!("{error}{hint}"), code }
    }
}

#[cfg(feature = "viewer")]
impl From<splitplane_viewer::FrameError> for Failure {
    fn from(error: splitplane_viewer::FrameError) -> Failure {
        use splitplane_viewer::FrameError;
        match error {
            FrameError::Open(error) => error.into(),
            FrameError::Mesh(error) => error.into(),
            FrameError::Build(error) => error.into(),
            FrameError::Query(error) => error.into(),
            FrameError::Tracer(error) => error.into(),
            FrameError::Animation(error) => Failure::file(error),
            other => Failure { message: other.to_string(), code: BUG },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What a window cannot be made to do at will.
    #[cfg(feature = "viewer")]
    #[test]
    fn ends_of_the_window_have_their_codes() {
        use splitplane_viewer::{FrameError, ViewerError};
        let text = || "gone".to_owned();
        assert_eq!(Failure::from(ViewerError::DeviceLost(text())).code, DEVICE);
        assert_eq!(Failure::from(ViewerError::Device(text())).code, DEVICE);
        assert_eq!(Failure::from(ViewerError::NoSurface(vec![text()])).code, NO_GPU);
        assert_eq!(Failure::from(ViewerError::Window(text())).code, NO_GPU);
        assert_eq!(Failure::from(ViewerError::Adapter(OpenError::NoAdapter)).code, NO_GPU);
        let lost = FrameError::Query(DeviceError::Lost { reason: text() }.into());
        assert!(lost.is_device_loss());
        assert_eq!(Failure::from(ViewerError::Frame(lost)).code, DEVICE);
        let memory = FrameError::Build(BuildError::OutOfMemory { needed: 2, limit: 1 });
        assert!(!memory.is_device_loss());
        assert_eq!(Failure::from(ViewerError::Frame(memory)).code, LIMIT);
        assert_eq!(Failure::from(ViewerError::Frame(FrameError::Superseded)).code, BUG);
    }

    /// Codes that no run of this build can reach from outside.
    #[test]
    fn limits_and_failing_devices_have_their_codes() {
        let too_large = BuildError::TooLarge { nodes: 1 << 31, references: 0 };
        assert_eq!(Failure::from(too_large).code, LIMIT);
        assert_eq!(Failure::from(MeshError::TooManyTriangles { triangles: 1 << 30 }).code, LIMIT);
        let text = || "gone".to_owned();
        let errors = [
            (DeviceError::Failed(text()), DEVICE),
            (DeviceError::Lost { reason: text() }, DEVICE),
            (DeviceError::TimedOut { seconds: 1 }, DEVICE),
            (DeviceError::OutOfMemory { what: text(), needed: 1 }, LIMIT),
            (DeviceError::Limit { what: text(), limit: text(), needed: 2, allowed: 1 }, LIMIT),
        ];
        for (error, code) in errors {
            assert_eq!(Failure::from(BuildError::from(error.clone())).code, code, "{error}");
            assert_eq!(Failure::from(QueryError::from(error.clone())).code, code, "{error}");
        }
        let failed = OpenError::DeviceFailed { adapter: text(), reason: text() };
        assert_eq!(Failure::from(failed).code, DEVICE);
        let structural = OpenError::Structural { adapter: text(), difference: text() };
        let refused = Failure::from(structural);
        assert_eq!(refused.code, NO_GPU);
        assert!(refused.message.ends_with("; --allow-structural allows it"), "{}", refused.message);
        assert_eq!(Failure::from(QueryError::LengthMismatch { rays: 1, results: 2 }).code, BUG);
    }

    /// Nor can these: photons are cancelled with the frame, and few enough to fit.
    #[test]
    fn photons_have_their_codes() {
        let of = |error: RenderError| Failure::from(TracerError::Render(error)).code;
        let cancelled = PointBuildError::Cancelled { done: 1, total: 2 };
        let memory = PointBuildError::OutOfMemory { needed: 2, limit: 1 };
        assert_eq!(of(RenderError::PhotonMap(cancelled)), CANCELLED);
        assert_eq!(of(RenderError::PhotonMap(memory)), LIMIT);
        assert_eq!(of(RenderError::TooManyPhotons { photons: 9, needed: 2, allowed: 1 }), LIMIT);
    }

    /// Libraries say what is wrong; which option helps is said here.
    #[test]
    fn errors_of_libraries_name_no_option_and_failures_do() {
        let problem = ObjProblem::TooLong { limit: 7 };
        let obj = ObjError { file: "a.obj".into(), line: None, problem };
        let unknown = SceneError::UnknownFormat("a.dae".into());
        for (error, hint) in [
            (SceneError::Obj(obj), "; --max-file allows more"),
            (unknown, "; `splitplane --help` lists the verbs"),
        ] {
            let said = error.to_string();
            assert!(!said.contains("--"), "{said}");
            assert_eq!(Failure::from(error).message, said + hint);
        }
    }
}
