//! Configurations for tests that run a list of them through several builders.

use splitplane_core::config::{BuildConfig, Builder, Preset};

/// The configuration with the builder of another preset that has stages. The knobs of the stages stay, and so do bins
/// where both builders have them.
///
/// # Panics
/// Where one of both builders has no stages.
pub fn with_builder_of(preset: Preset, config: BuildConfig) -> BuildConfig {
    let stages = *config.stages().expect("a builder with stages");
    let mut other = preset.config();
    *other.stages_mut().expect("a builder with stages") = stages;
    if let (Some(bins), Builder::Binned { bins: kept, .. }) = (other.bins_mut(), config.builder) {
        *bins = kept;
    }
    BuildConfig { builder: other.builder, ..config }
}

/// The configuration with each builder that has stages.
pub fn by_every_staged_builder(config: BuildConfig) -> [BuildConfig; 2] {
    [Preset::Fast, Preset::Balanced].map(|preset| with_builder_of(preset, config))
}
