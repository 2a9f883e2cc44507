//! The settings of a build, checked.

use library::{BuildConfig, BuildOptions as LibraryBuildOptions, QueryLayout};

use crate::buffer::{check, text};
use crate::options::{
    BUILD_DEFAULTS, BuildOptions, Knob, LAYOUTS, PRESETS, chosen, limit, reserved, settings,
};
use crate::progress::{Caller, caller, watch};
use crate::status::{Failure, Status};

/// The settings of a build, checked.
pub(crate) struct Build {
    options: LibraryBuildOptions<'static>,
    pub(crate) caller: Option<Caller>,
    pub(crate) threads: u32,
}

impl Build {
    /// # Safety
    /// See [`settings`]; knobs are there as they say.
    pub(crate) unsafe fn read(options: *const BuildOptions) -> Result<Build, Failure> {
        // SAFETY: as the caller says.
        let own = unsafe { settings(options, BUILD_DEFAULTS)? };
        reserved(own.reserved)?;
        let mut config = chosen(own.preset, &PRESETS, "preset")?.config();
        let layout = chosen(own.layout, &LAYOUTS, "layout")?;
        // SAFETY: as the caller says.
        unsafe { turn(&mut config, own.knobs, own.knob_count)? };
        config.validate()?;
        let max_memory = limit(own.max_memory);
        Ok(Build {
            options: LibraryBuildOptions { config, layout, max_memory, watch: None },
            caller: caller(own.progress, own.user),
            threads: own.threads,
        })
    }

    pub(crate) fn options(&self) -> LibraryBuildOptions<'_> {
        LibraryBuildOptions { watch: watch(&self.caller), ..self.options }
    }

    /// Refuses what a load finds in its file.
    pub(crate) fn for_loading(&self) -> Result<(), Failure> {
        match self.options.config == BuildConfig::default() {
            true => Ok(()),
            false => {
                let text = "a file has its own configuration: preset and knobs mean nothing here";
                Err(Failure::new(Status::Option, text))
            }
        }
    }

    /// Refuses what a build of points does not use.
    pub(crate) fn for_points(&self) -> Result<(), Failure> {
        self.for_loading()?;
        match self.options.layout == QueryLayout::Fast {
            true => Ok(()),
            false => Err(Failure::new(Status::Option, "a point tree has one layout")),
        }
    }
}

/// Turns knobs.
///
/// # Safety
/// So many are there.
unsafe fn turn(config: &mut BuildConfig, first: *const Knob, count: usize) -> Result<(), Failure> {
    if count > 64 {
        return Err(Failure::new(Status::Count, format!("{count} knobs are more than there are")));
    }
    for place in 0..count {
        check(first, "options: `knobs`")?;
        // SAFETY: so many are there.
        let knob = unsafe { first.add(place).read() };
        // SAFETY: as above.
        let name = unsafe { text(knob.name, "the name of a knob")? };
        let known = match name {
            "traversal_cost" => Some(&mut config.traversal_cost),
            "intersection_cost" => Some(&mut config.intersection_cost),
            "block_width" => Some(&mut config.block_width),
            "max_depth" => Some(&mut config.max_depth),
            "references_per_triangle" => Some(&mut config.references_per_triangle),
            "clip" if knob.value <= 1 => {
                config.clip = knob.value == 1;
                continue;
            }
            "clip" => return Err(Failure::new(Status::Option, "clip is 0 or 1")),
            "small_node_limit" => config.stages_mut().map(|stages| &mut stages.small_node_limit),
            "empty_cutoff" => config.stages_mut().map(|stages| &mut stages.empty_cutoff),
            "nodes_per_triangle" => {
                config.stages_mut().map(|stages| &mut stages.nodes_per_triangle)
            }
            "bins" => config.bins_mut(),
            "empty_bonus" => config.sweep_mut().map(|sweep| &mut sweep.empty_bonus),
            "bad_splits" => config.sweep_mut().map(|sweep| &mut sweep.bad_splits),
            _ => return Err(Failure::new(Status::Option, format!("there is no knob `{name}`"))),
        };
        *known.ok_or_else(|| {
            Failure::new(Status::Option, format!("the preset's builder has no knob `{name}`"))
        })? = knob.value;
    }
    Ok(())
}
