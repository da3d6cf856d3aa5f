use super::*;
use crate::config::{CriterionKind, Mode};
use crate::drift::DriftCoefficient;
use crate::platform::{AxisValue, GSensitivePrior, Repositioning};
use proptest::prelude::*;

fn parse(text: &str) -> Result<StudySource> {
    StudySource::parse(text, None)
}

#[test]
fn the_embedded_file_says_the_defaults() {
    let source = parse(DEFAULT_TOML).unwrap();
    assert_eq!(source.config, StudyConfig::default());
    // It gives everything but what it shows commented out.
    assert_eq!(
        source.defaulted(),
        [
            "gimbals.alpha_deg",
            "gimbals.beta_deg",
            "gimbals.gamma_deg",
            "gimbals.step_deg",
            "motion.slew_rate_deg_per_s",
            "search.max_positions"
        ]
    );
    source.check().unwrap();
}

#[test]
fn the_embedded_file_shows_every_key_and_its_commented_keys_are_right() {
    // What is commented out starts with `# key = value` or `# [table]`.
    let is_code = |rest: &str| {
        rest.starts_with("[objective.")
            || rest
                .split_once(" = ")
                .is_some_and(|(key, _)| keys::elsewhere("", key).is_some() && !key.contains(' '))
    };
    let uncommented: Vec<&str> = DEFAULT_TOML
        .lines()
        // In their other forms, and what names a file that is not there.
        .filter(|line| {
            let left_out = ["random_drift", "noise_g", "# use = ", "# allowed = "];
            !left_out.iter().any(|key| line.starts_with(key))
        })
        .map(|line| match line.strip_prefix("# ") {
            Some(rest) if is_code(rest) => rest,
            _ => line,
        })
        .collect();
    let source = parse(&uncommented.join("\n")).unwrap();
    source.check().unwrap();
    for (key, _) in keys::KNOWN.iter() {
        let name = key.rsplit('.').next().unwrap();
        assert!(DEFAULT_TOML.contains(name), "{key}");
    }
    assert_eq!(source.defaulted(), [""; 0]);
    assert_eq!(source.config.search.threads, Some(4));
}

#[test]
fn everything_can_be_given() {
    let source = parse(
        r#"
        gyro.angle_random_walk_deg_per_sqrt_h = 5e-4
        [site]
        latitude_deg = -33
        [prior]
        misalignment_deg = [0.1, 0.2, 3]
        g_sensitive_drift_deg_per_h_per_g = { input = 1, output = [1, 2, 3], spin = 4.5 }
        [gimbals]
        beta_deg = [-60, 60.5]
        [motion]
        repositioning = "frame-hold"
        [objective]
        mode = "pareto"
        criterion = "max-ratio"
        spec_deg_per_h = { default = 1, D_IX = 0.01 }
        score.separability_weight = 2
        [search]
        seed = 18446744073709551615
        "#,
    )
    .unwrap();
    let c = &source.config;
    assert_eq!(c.platform.site.latitude_deg, -33.0);
    assert_eq!(c.platform.gyro.random_drift_deg_per_h, None);
    assert_eq!(
        c.platform.prior.misalignment_deg,
        AxisValue::PerAxis([0.1, 0.2, 3.0])
    );
    assert!(matches!(
        c.platform.prior.g_sensitive_drift_deg_per_h_per_g,
        GSensitivePrior::PerAxis { .. }
    ));
    assert_eq!(c.platform.gimbals.beta_deg, Some([-60.0, 60.5]));
    assert_eq!(c.platform.motion.repositioning, Repositioning::FrameHold);
    assert_eq!(c.objective.mode, Mode::Pareto);
    assert_eq!(c.objective.criterion, CriterionKind::MaxRatio);
    assert_eq!(
        c.objective.spec_deg_per_h.of(DriftCoefficient::IX),
        Some(0.01)
    );
    assert_eq!(c.objective.score.separability_weight, 2.0);
    assert_eq!(c.search.seed, u64::MAX);
    let defaulted = source.defaulted();
    for given in ["site.latitude_deg", "gyro.random_drift_deg_per_h"] {
        assert!(!defaulted.iter().any(|key| key == given), "{given}");
    }
    for not_given in [
        "filter.period_s",
        "objective.total_time_s",
        "gimbals.alpha_deg",
    ] {
        assert!(defaulted.iter().any(|key| key == not_given), "{not_given}");
    }
    source.check().unwrap();
}

#[test]
fn an_empty_file_is_the_embedded_default() {
    assert_eq!(parse("").unwrap(), StudySource::embedded_default());
    assert_eq!(parse("\u{feff}").unwrap(), StudySource::embedded_default());
}

#[test]
fn bad_files_are_refused_with_line_key_and_advice() {
    // (text, line, key, part of the message)
    let table = [
        (
            "[site]\nlatitude = 1",
            2,
            "site.latitude",
            "`latitude_deg`?",
        ),
        (
            "[site]\nlatitude_rad = 1",
            2,
            "site.latitude_rad",
            "there is `latitude_deg`, in another unit",
        ),
        ("\n[sites]\nx = 1", 2, "sites", "`site`?"),
        (
            "[errors]\naccelerometer_bias = 1",
            2,
            "errors.accelerometer_bias",
            "`accelerometer_bias_ug`?",
        ),
        (
            "[errors]\naccelerometer_bias_ug = \"1\"",
            2,
            "errors.accelerometer_bias_ug",
            "a number, or three",
        ),
        (
            "[errors]\naccelerometer_bias_ug = [1, 2]",
            2,
            "errors.accelerometer_bias_ug",
            "wrong number of values",
        ),
        (
            "[errors]\nlocal_gravity_ug = [1, 2, 3]",
            2,
            "errors.local_gravity_ug",
            "a number",
        ),
        (
            "[errors.considered]\n\naccelerometer_bias_ug = true",
            3,
            "errors.considered.accelerometer_bias_ug",
            "a number, or three",
        ),
        ("errors = 3", 1, "errors", "a table [errors]"),
        (
            "[errors]\nconsidered = 3",
            2,
            "errors.considered",
            "a table [errors.considered]",
        ),
        (
            "[errors.parameter]\nT_XW = 3",
            2,
            "errors.parameter.T_XW",
            "`T_X",
        ),
        (
            "[errors.parameter]\nT_XY = [1, 2, 3]",
            2,
            "errors.parameter.T_XY",
            "a number",
        ),
        (
            "[errors.considered.parameter]\nK0X = 3",
            2,
            "errors.considered.parameter.K0X",
            "`K_0X`?",
        ),
        (
            "[gyro]\noutput_axis = { W = \"-z\" }",
            2,
            "gyro.output_axis.W",
            "allowed: X, Y, Z",
        ),
        (
            "[gyro]\noutput_axis = \"-z\"",
            2,
            "gyro.output_axis",
            "a table [gyro.output_axis]",
        ),
        (
            "[gyro.output_axis]\nX = [0, 1]",
            2,
            "gyro.output_axis.X",
            "unit vector",
        ),
        (
            "[gyro.output_axis]\nX = 3",
            2,
            "gyro.output_axis.X",
            "unit vector",
        ),
        (
            "[azimuth]\nnoise_arcsec = \"5\"",
            2,
            "azimuth.noise_arcsec",
            "without quotes",
        ),
        (
            "[azimuth]\nnoise = 5",
            2,
            "azimuth.noise",
            "`noise_arcsec`?",
        ),
        (
            "latitude_deg = 1",
            1,
            "latitude_deg",
            "`site.latitude_deg`?",
        ),
        (
            "[site]\nperiod_s = 1",
            2,
            "site.period_s",
            "`filter.period_s`?",
        ),
        ("[site]\nfoo = 1", 2, "site.foo", "allowed: latitude_deg"),
        (
            "\"site.latitude_deg\" = 1",
            1,
            "site.latitude_deg",
            "unknown key",
        ),
        (
            "[objective.spec_deg_per_h]\nD_XX = 1",
            2,
            "objective.spec_deg_per_h.D_XX",
            "allowed: default, D_FX",
        ),
        (
            "[objective.spec_deg_per_h]\nd_ix = 1",
            2,
            "objective.spec_deg_per_h.d_ix",
            "`D_IX`?",
        ),
        (
            "[objective.score]\nseparability = 1",
            2,
            "objective.score.separability",
            "`separability_weight`?",
        ),
        (
            "[prior]\ng_sensitive_drift_deg_per_h_per_g = { inputs = 1 }",
            2,
            "prior.g_sensitive_drift_deg_per_h_per_g.inputs",
            "`input`?",
        ),
        (
            "[prior]\ng_sensitive_drift_deg_per_h_per_g = { input = 1 }",
            2,
            "prior.g_sensitive_drift_deg_per_h_per_g",
            "missing field",
        ),
        (
            "[prior.g_sensitive_drift_deg_per_h_per_g]\ninput = 1\noutput = 2\nspin = true",
            4,
            "prior.g_sensitive_drift_deg_per_h_per_g.spin",
            "= true: wrong type; allowed: a number, or three",
        ),
        (
            "[site]\nlatitude_deg = \"28.2\"",
            2,
            "site.latitude_deg",
            "without quotes",
        ),
        (
            "[site]\nlatitude_deg = true",
            2,
            "site.latitude_deg",
            "= true: wrong type; allowed: a number",
        ),
        (
            "[site]\nlatitude_deg = 1979-05-27",
            2,
            "site.latitude_deg",
            "allowed: a number",
        ),
        (
            "[site]\nlatitude_deg = 1e999",
            2,
            "site.latitude_deg",
            "overflow",
        ),
        (
            "[site]\nlatitude_deg = [1]",
            2,
            "site.latitude_deg",
            "allowed: a number",
        ),
        (
            "[site.latitude_deg]\nx = 1",
            1,
            "site.latitude_deg",
            "a number",
        ),
        ("site = 5", 1, "site", "a table [site]"),
        ("[[site]]\nlatitude_deg = 1", 1, "site", "a table [site]"),
        (
            "[objective]\nspec_deg_per_h = 0.005",
            2,
            "objective.spec_deg_per_h",
            "spec_deg_per_h.default = 0.005",
        ),
        (
            "[prior]\nmisalignment_deg = [1, 2]",
            2,
            "prior.misalignment_deg",
            "= [1, 2]: wrong number of values",
        ),
        (
            "[prior]\nmisalignment_deg = [1, 2, 3, 4]",
            2,
            "prior.misalignment_deg",
            "[x, y, z]",
        ),
        (
            "[prior]\nmisalignment_deg = [1, \"2\", 3]",
            2,
            "prior.misalignment_deg",
            "[x, y, z]",
        ),
        (
            "[gimbals]\nbeta_deg = [-60, 0, 60]",
            2,
            "gimbals.beta_deg",
            "[low, high]",
        ),
        (
            "[gimbals]\nbeta_deg = 60",
            2,
            "gimbals.beta_deg",
            "= 60: wrong type; allowed: two numbers",
        ),
        (
            "[gimbals]\nbeta_deg = [-60,\n \"x\"]",
            2,
            "gimbals.beta_deg",
            "[low, high]",
        ),
        (
            "[objective]\nmode = \"acuracy\"",
            2,
            "objective.mode",
            "did you mean `accuracy`?",
        ),
        (
            "[objective]\ncriterion = 3",
            2,
            "objective.criterion",
            "\"max-ratio\"",
        ),
        (
            "[motion]\nrepositioning = \"hold\"",
            2,
            "motion.repositioning",
            "\"slew\", \"frame-hold\"",
        ),
        (
            "[motion]\nmeasure_moves = 1",
            2,
            "motion.measure_moves",
            "true or false",
        ),
        (
            "[motion]\nmeasure_moves = \"true\"",
            2,
            "motion.measure_moves",
            "true or false",
        ),
        (
            "[search]\nmax_positions = 24.0",
            2,
            "search.max_positions",
            "a whole number",
        ),
        (
            "[search]\nseed = -1",
            2,
            "search.seed",
            "a whole number, 0 or more",
        ),
        (
            "[search]\nthreads = \"all\"",
            2,
            "search.threads",
            "a whole number",
        ),
        (
            "[site]\nlatitude_deg = 1\nlatitude_deg = 2",
            3,
            "latitude_deg",
            "duplicate key",
        ),
    ];
    let mut failed = String::new();
    for (text, line, key, says) in table {
        let error = parse(text).unwrap_err();
        assert!(error.is_input());
        if error.line() != Some(line)
            || error.key() != Some(key)
            || !error.to_string().contains(says)
        {
            failed += &format!("{text}\n  {:?} {error}\n", error.line());
        }
    }
    assert!(failed.is_empty(), "{failed}");
}

#[test]
fn errors_are_read_with_their_lines() {
    let text = "[errors]\naccelerometer_bias_ug = 100\nlocal_gravity_ug = 3\n\
                [errors.parameter]\nT_XY = 5\n\
                [errors.considered]\nquadratic_drift_deg_per_h_per_g2 = [0.1, 0.2, 0.3]\n\
                [errors.considered.parameter]\nK_1X = -2\n\
                [gyro]\noutput_axis = { X = \"+y\", Z = [0, 1, 0] }\n\
                [azimuth]\nnoise_arcsec = 5\n";
    let mut source = parse(text).unwrap();
    let error = source.check().unwrap_err();
    assert_eq!(error.line(), Some(9));
    assert_eq!(error.key(), Some("errors.considered.parameter.K_1X"));
    let considered = &mut source.config.platform.errors.considered;
    considered.parameter.insert("K_1X".to_owned(), 2.0);
    let platform = source.check().unwrap().test().platform().clone();
    assert_eq!(
        platform.errors().parameters().len(),
        12 + 3 + 1 + 1 + 15 + 1
    );
    assert_eq!(platform.errors().estimated(), 12 + 3 + 1 + 1);
    assert!(platform.azimuth_noise_rad().is_some());
    // As documents carry it.
    let json = serde_json::to_value(&source.config).unwrap();
    assert_eq!(json["errors"]["considered"]["parameter"]["K_1X"], 2.0);
    assert_eq!(json["errors"]["accelerometer_bias_ug"], 100.0);
    let back: StudyConfig = serde_json::from_value(json).unwrap();
    assert_eq!(back, source.config);
}

#[test]
fn text_that_is_not_toml_is_refused_with_its_line() {
    for (text, line, says) in [
        ("[site]\nlatitude_deg = 28,2", 2, "with a point"),
        ("[site\nlatitude_deg = 28", 1, ""),
        ("[site]\nlatitude_deg 28", 2, ""),
        ("[site]\nlatitude_deg = ", 2, ""),
        ("[site]\n[filter]\n[site]\n", 3, "duplicate key"),
        ("{\"site\": 1}", 1, ""),
    ] {
        let error = parse(text).unwrap_err();
        assert!(error.is_input());
        assert_eq!(error.line(), Some(line), "{text}: {error}");
        assert!(error.to_string().contains(says), "{error}");
    }
}

#[test]
fn range_errors_point_at_the_line_and_overridden_keys_do_not() {
    let path = Path::new("stand.toml");
    let text = "[site]\n\nlatitude_deg = nan\n[objective]\ntotal_time_s = 10\n";
    let mut source = StudySource::parse(text, Some(path)).unwrap();
    let error = source.check().unwrap_err();
    assert_eq!((error.file(), error.line()), (Some(path), Some(3)));
    assert_eq!(error.key(), Some("site.latitude_deg"));
    assert!(
        error
            .to_string()
            .starts_with("stand.toml:3: site.latitude_deg = NaN")
    );

    source.config.platform.site.latitude_deg = 10.0;
    source.override_key("site.latitude_deg");
    let error = source.check().unwrap_err();
    assert_eq!(error.key(), Some("objective.total_time_s"));
    assert_eq!(error.line(), Some(5));

    source.override_key("objective");
    let error = source.check().unwrap_err();
    assert_eq!((error.file(), error.line()), (None, None));

    // Of two values the one that is given, not the one that is assumed.
    let text = "[motion]\nmin_dwell_s = 20000";
    let error = StudySource::parse(text, Some(path))
        .unwrap()
        .check()
        .unwrap_err();
    assert_eq!((error.file(), error.line()), (Some(path), Some(2)));
    assert_eq!(error.key(), Some("motion.min_dwell_s"));

    for (text, line, key) in [
        ("[gimbals]\nstep_deg = inf", 2, "gimbals.step_deg"),
        (
            "[prior]\ng_sensitive_drift_deg_per_h_per_g = { input = 1, output = 1,\nspin = -1 }",
            3,
            "prior.g_sensitive_drift_deg_per_h_per_g.spin",
        ),
        (
            "[objective.spec_deg_per_h]\ndefault = 1\nD_OZ = 0",
            3,
            "objective.spec_deg_per_h.D_OZ",
        ),
    ] {
        let error = parse(text).unwrap().check().unwrap_err();
        assert_eq!((error.line(), error.key()), (Some(line), Some(key)));
    }
}

#[test]
fn overriding_a_key_takes_it_off_the_defaults() {
    let mut source = StudySource::embedded_default();
    let before = source.defaulted().len();
    source.override_key("search.seed");
    source.override_key("objective.score");
    assert_eq!(source.defaulted().len(), before - 5);
}

#[test]
fn errors_name_the_file() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("stand.toml");
    std::fs::write(&path, "\u{feff}[site]\nlatitude = 3").unwrap();
    let error = StudySource::read(&path).unwrap_err();
    assert_eq!(
        (error.file(), error.line()),
        (Some(path.as_path()), Some(2))
    );
    std::fs::write(&path, "[site]\r\nlatitude_deg = 3\r\n").unwrap();
    let source = StudySource::read(&path).unwrap();
    assert_eq!(source.file(), Some(path.as_path()));
    assert_eq!(source.config.platform.site.latitude_deg, 3.0);
    assert!(
        StudySource::read(&dir.path().join("none.toml"))
            .unwrap_err()
            .is_io()
    );
}

proptest! {
    #[test]
    fn no_text_makes_the_reader_panic(text in ".{0,60}", key in 0..keys::KNOWN.len()) {
        let _ = parse(&text);
        let _ = parse(&format!("{} = {text}", keys::KNOWN[key].0)).map(|s| s.check());
    }
}
