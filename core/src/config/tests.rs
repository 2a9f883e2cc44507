//! Ranges, words and knobs of configurations.

use super::*;

#[test]
fn presets_are_valid_and_words_round_trip() {
    assert_eq!(BuildConfig::default(), Preset::Fast.config());
    assert_eq!("FAST".parse::<Preset>(), Err(UnknownPreset));
    let words = BuildConfig::default().words();
    assert_eq!(words[9..], [0; 4], "digests of the first builder stay what they were");
    for (number, preset) in [0, 0, 1, 2].into_iter().zip(Preset::ALL) {
        let config = preset.config();
        assert_eq!((config.preset(), config.validate()), (preset, Ok(())));
        assert_eq!(preset.name().parse(), Ok(preset));
        assert_eq!(config.words()[0], number);
        assert_eq!(config.stages().is_some(), preset.planes().is_some());
        assert_eq!(BuildConfig::from_words(config.words()), Some(config));
        let config = BuildConfig { clip: false, ..config };
        assert_eq!(BuildConfig::from_words(config.words()), Some(config));
        let mut words = config.words();
        words[10] = 2;
        assert_eq!(BuildConfig::from_words(words), None);
    }
}

/// Two presets have one builder: a configuration that is neither is called after the builder.
#[test]
fn narrow_is_known_by_all_its_knobs() {
    let narrow = Preset::Narrow.config();
    assert_eq!(narrow.builder.preset(), Preset::Fast);
    let other = BuildConfig { block_width: 2, ..narrow };
    assert_eq!((narrow.preset(), other.preset()), (Preset::Narrow, Preset::Fast));
    let last = narrow.with_stages(|stages| stages.nodes_per_triangle = 5);
    assert_eq!(last.preset(), Preset::Fast);
    assert_eq!(BuildConfig { clip: false, ..narrow }.preset(), Preset::Fast);
}

/// No word can hold what the builder does not read.
#[test]
fn words_of_other_builders_are_refused() {
    let others: [&[usize]; 4] = [&[9, 11, 12], &[9, 11, 12], &[11, 12], &[4, 5, 8, 9]];
    for (preset, others) in Preset::ALL.into_iter().zip(others) {
        for &place in others {
            let mut words = preset.config().words();
            words[place] = 4;
            assert_eq!(BuildConfig::from_words(words), None, "{preset:?}, word {place}");
        }
        let mut words = preset.config().words();
        words[0] = 3;
        assert_eq!(BuildConfig::from_words(words), None);
    }
}

#[test]
fn knobs_belong_to_their_builders() {
    for preset in Preset::ALL {
        let own = preset.config();
        let mut config = own;
        assert_eq!(config.stages_mut().is_some(), preset != Preset::Best);
        assert_eq!(config.bins_mut().is_some(), preset == Preset::Balanced);
        assert_eq!(config.sweep_mut().is_some(), preset == Preset::Best);
        assert_eq!(config.stages().copied(), config.stages_mut().copied());
        assert_eq!(config.sweep().copied(), config.sweep_mut().copied());
        assert_eq!(config.bins(), config.bins_mut().copied().unwrap_or(0));
    }
    let staged = Preset::Fast.config().with_stages(|stages| stages.small_node_limit = 7);
    assert_eq!((staged.small_node_limit(), staged.words()[4]), (7, 7));
    let staged = Preset::Balanced.config().with_stages(|stages| stages.empty_cutoff = 7);
    assert_eq!((staged.empty_cutoff(), staged.words()[5]), (7, 7));
    assert_eq!(Preset::Balanced.config().with_bins(7).words()[9], 7);
    let swept = Preset::Best.config().with_sweep(|sweep| sweep.bad_splits = 7);
    assert_eq!(swept.words()[12], 7);
}

#[test]
#[should_panic = "a builder with bins"]
fn a_knob_that_a_builder_has_not_is_not_set_in_silence() {
    let _ = Preset::Fast.config().with_bins(7);
}

#[test]
fn each_field_is_checked() {
    let staged = |change: fn(&mut Stages)| BuildConfig::default().with_stages(change);
    let best = Preset::Best.config();
    let bad = [
        ("traversal_cost", BuildConfig { traversal_cost: 0, ..Default::default() }),
        ("intersection_cost", BuildConfig { intersection_cost: 0, ..Default::default() }),
        ("block_width", BuildConfig { block_width: 0, ..Default::default() }),
        ("max_depth", BuildConfig { max_depth: 97, ..Default::default() }),
        ("references_per_triangle", {
            BuildConfig { references_per_triangle: 0, ..Default::default() }
        }),
        ("small_node_limit", staged(|stages| stages.small_node_limit = 65)),
        ("empty_cutoff", staged(|stages| stages.empty_cutoff = 256)),
        ("nodes_per_triangle", staged(|stages| stages.nodes_per_triangle = 0)),
        ("bins", Preset::Balanced.config().with_bins(1)),
        ("bins", Preset::Balanced.config().with_bins(65)),
        ("empty_bonus", best.with_sweep(|sweep| sweep.empty_bonus = 256)),
        ("bad_splits", best.with_sweep(|sweep| sweep.bad_splits = 9)),
    ];
    for (name, config) in bad {
        let found = config.validate();
        assert!(
            matches!(found, Err(ConfigError::OutOfRange { field, .. }) if field == name),
            "{config:?}: {found:?}"
        );
        assert_eq!(BuildConfig::from_words(config.words()), None);
    }
    let heavy = BuildConfig { intersection_cost: 200, block_width: 1, ..Default::default() };
    assert!(matches!(heavy.validate(), Err(ConfigError::CostTooLarge { .. })));
    assert_eq!(BuildConfig { builder: best.builder, ..heavy }.validate(), Ok(()));
}

/// The derivation of [`BuildConfig::MAX_COST`].
#[test]
fn the_greatest_cost_fits_32_bits() {
    let area = 3 * 1023u64 * 1023;
    assert!(area * u64::from(BuildConfig::MAX_COST) <= u64::from(u32::MAX));
}

/// What a preset says is part of every digest: these words change together with
/// [`crate::tree::DIGEST_VERSION`] only.
#[test]
fn presets_stay_what_they_are() {
    let words = Preset::ALL.map(|preset| preset.config().words());
    assert_eq!(
        words,
        [
            [0, 1, 4, 16, 64, 64, 64, 8, 4, 0, 0, 0, 0],
            [0, 1, 1, 1, 64, 64, 64, 8, 4, 0, 0, 0, 0],
            [1, 1, 4, 16, 64, 64, 64, 8, 4, 32, 0, 0, 0],
            [2, 1, 2, 8, 0, 0, 64, 8, 0, 0, 0, 26, 0],
        ]
    );
}
