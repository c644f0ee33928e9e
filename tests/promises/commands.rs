//! Exit codes, output width, JSON schema and error messages of the commands.

use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::{self, Read as _};
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::thread;
use std::time::Duration;

use log_analysis::log::log_writers::encode_blackbox;
use rustix::process::Signal;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use serde_json::Value;
use simulator::recording::record_turns;
use simulator::world::WorldConfig;
use testkit::documents::{self, repository_root};

use crate::fixtures::program::{self, interrupt_for_exit_code};

fn host_sim_command(arguments: &str) -> Command {
    program::host_sim_command(arguments.split(' '))
}

/// Exit code, standard output and error output.
fn run_command(arguments: &str) -> (Option<i32>, String, String) {
    let Output { status, stdout, stderr } = host_sim_command(arguments).output().unwrap();
    (status.code(), String::from_utf8(stdout).unwrap(), String::from_utf8(stderr).unwrap())
}

fn stdout_text(arguments: &str) -> String {
    let (code, stdout_text, stderr_text) = run_command(arguments);
    assert!(code.is_some_and(|code| code < 2), "{arguments}: {code:?} {stderr_text}");
    stdout_text
}

/// Short runs of each command that needs no emulator.
const SHORT_RUNS: [&str; 9] = [
    "fly --json --circles 0.1",
    "table1",
    "fly --airframe host-sim/airframes/example.toml --circles 0.1 --json",
    "replay host-sim/data/flight.csv",
    "replay --json host-sim/data/flight.csv",
    "bench accuracy --airframes 1 --draws 1",
    "bench accuracy --aircraft copter --airframes 1 --draws 1 --minutes 1",
    "bench integrity --flights 1 --case clean",
    "bench integrity --case list",
];

/// A shell reports 128 plus SIGPIPE's number, 13.
#[test]
fn a_closed_pipe_ends_every_command_silently() {
    for arguments in SHORT_RUNS.iter().chain(&["fly --circles 0.1", "bench speed", "serve", "serve --json --tcp 0"]) {
        let folder = tempfile::tempdir().unwrap();
        let report =
            if arguments.starts_with("fly") { format!(" --report {}", folder.path().display()) } else { String::new() };
        for is_heard in [true, false] {
            let (reader, writer) = io::pipe().unwrap();
            drop(reader);
            let mut command = host_sim_command(&format!("{arguments}{report}"));
            command.stdin(Stdio::null()).stdout(writer.try_clone().unwrap());
            command.stderr(if is_heard { Stdio::piped() } else { writer.into() });
            let mut child = command.spawn().unwrap();
            drop(command);
            let code = child.wait().unwrap().code();
            let mut stderr_text = String::new();
            child.stderr.take().map(|mut stderr| stderr.read_to_string(&mut stderr_text));
            assert_eq!((code, stderr_text.as_str()), (Some(141), ""), "{arguments}");
        }
    }
}

#[test]
fn a_full_disk_is_reported() {
    let full = File::options().write(true).open("/dev/full").unwrap();
    let Output { status, stderr, .. } = host_sim_command("table1").stdout(full).output().unwrap();
    assert_eq!(status.code(), Some(2));
    assert!(String::from_utf8_lossy(&stderr).contains("cannot write to the standard output: No space left"));
}

fn wait_for_interrupt_handler(pid: u32) {
    for _ in 0..6000 {
        let status = fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
        let mask = status.lines().find_map(|line| line.strip_prefix("SigCgt:")).unwrap().trim();
        if u64::from_str_radix(mask, 16).unwrap() & 1 << (Signal::INT.as_raw() - 1) != 0 {
            return;
        }
        thread::sleep(Duration::from_millis(10));
    }
    panic!("it does not listen to Ctrl-C");
}

#[test]
fn ctrl_c_ends_a_long_run() {
    for arguments in ["bench accuracy --airframes 1000000", "bench integrity --flights 100000", "serve"] {
        let mut child = host_sim_command(arguments).stdout(Stdio::null()).spawn().unwrap();
        wait_for_interrupt_handler(child.id());
        assert_eq!(interrupt_for_exit_code(&mut child), Some(130), "{arguments}");
    }
}

/// ELF header for an ARM executable, without content.
const ELF_HEADER: &[u8] = b"\x7fELF\x01\x01\x01\0\0\0\0\0\0\0\0\0\x02\0\x28\0";

/// A substitute for QEMU that creates no sockets and runs for ten minutes.
#[test]
fn ctrl_c_leaves_no_emulator_and_no_files_behind() {
    for arguments in ["emulate", "bench budget"] {
        let folder = tempfile::tempdir().unwrap();
        let path_in_folder = |name: &str| folder.path().join(name);
        fs::write(path_in_folder("image.elf"), ELF_HEADER).unwrap();
        fs::write(path_in_folder("qemu-system-arm"), "#!/bin/sh\necho $$ > \"$PID_FILE\"\nexec sleep 600\n").unwrap();
        fs::set_permissions(path_in_folder("qemu-system-arm"), fs::Permissions::from_mode(0o755)).unwrap();
        fs::create_dir(path_in_folder("tmp")).unwrap();
        let path = format!("{}:{}", folder.path().display(), std::env::var("PATH").unwrap());
        let mut command = host_sim_command(&format!("{arguments} --image {}", path_in_folder("image.elf").display()));
        command.env("PATH", path).env("TMPDIR", path_in_folder("tmp")).env("PID_FILE", path_in_folder("pid"));
        let mut child = command.stdout(Stdio::null()).spawn().unwrap();
        let pid = loop {
            if let Some(pid) = fs::read_to_string(path_in_folder("pid")).ok().filter(|pid| pid.ends_with('\n')) {
                break pid.trim().to_owned();
            }
            assert!(child.try_wait().unwrap().is_none(), "{arguments} has ended");
            thread::sleep(Duration::from_millis(10));
        };
        assert!(Path::new("/proc").join(&pid).exists() && fs::read_dir(path_in_folder("tmp")).unwrap().count() == 1);
        assert_eq!(interrupt_for_exit_code(&mut child), Some(130), "{arguments}");
        let mut stderr_text = String::new();
        child.stderr.take().unwrap().read_to_string(&mut stderr_text).unwrap();
        assert_eq!(stderr_text, "", "{arguments}");
        assert!(!Path::new("/proc").join(&pid).exists(), "{arguments} left its emulator behind");
        assert_eq!(fs::read_dir(path_in_folder("tmp")).unwrap().count(), 0, "{arguments} left files behind");
    }
}

#[test]
fn tables_fit_a_terminal() {
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().display();
    let flights = [
        format!("fly --airframe random --seed 7 --report {report}"),
        format!("fly --aircraft copter --circles 0.1 --report {report}"),
        "bench integrity --flights 1 --case upset-byte-order --case moved-5".to_owned(),
        "bench accuracy --aircraft copter --airframes 1 --draws 1 --minutes 1".to_owned(),
    ];
    for arguments in SHORT_RUNS
        .iter()
        .copied()
        .filter(|arguments| !arguments.contains("--json"))
        .chain(flights.iter().map(String::as_str))
    {
        for line in stdout_text(arguments).lines() {
            assert!(line.chars().count() <= 80, "{arguments}: {line}");
        }
    }
}

/// Paths of all values: `a.b` in objects, `[]` in lists, `?` after a null.
fn collect_json_paths(value: &Value, path: &str, paths_found: &mut BTreeSet<String>) {
    match value {
        Value::Object(fields) => {
            for (name, value) in fields {
                collect_json_paths(value, format!("{path}.{name}").trim_start_matches('.'), paths_found);
            }
        }
        Value::Array(values) => {
            for value in values {
                collect_json_paths(value, &format!("{path}[]"), paths_found);
            }
        }
        Value::Null => {
            paths_found.insert(format!("{path}?"));
        }
        _ => {
            paths_found.insert(path.to_owned());
        }
    }
}

/// Whether a path matches a documented one, in which `*` is any name.
fn matches_documented_path(path: &str, documented: &str) -> bool {
    let (path, documented): (Vec<_>, Vec<_>) = (path.split('.').collect(), documented.split('.').collect());
    let is_same = |(output_part, pattern_part): (&&str, &&str)| *pattern_part == "*" || output_part == pattern_part;
    path.len() == documented.len() && path.iter().zip(&documented).all(is_same)
}

/// Whether a null replaces a documented value or object.
fn is_replaced_by_null(path: &str, documented: &str) -> bool {
    documented == path || [".", "[]"].iter().any(|below| documented.starts_with(&format!("{path}{below}")))
}

/// The paths of a section of docs/json-fields.txt.
fn documented_paths(section: &str) -> BTreeSet<String> {
    let text = documents::document_text("docs/json-fields.txt");
    let section = text.split("\n## ").find(|text| text.lines().next().unwrap().contains(section)).unwrap();
    section.lines().skip(1).filter(|line| !line.is_empty()).map(str::to_owned).collect()
}

/// Decimals of the unit, or nine digits for coefficients.
fn assert_digits(value: &Value, path: &str) {
    match value {
        Value::Object(fields) => {
            fields.iter().for_each(|(name, value)| assert_digits(value, &format!("{path}.{name}")));
        }
        Value::Array(values) => values.iter().for_each(|value| assert_digits(value, path)),
        Value::Number(number) if number.is_f64() => {
            let text = number.to_string();
            let decimals = text.split_once('.').map_or(0, |(_, decimals)| decimals.len());
            let is_good = if path.contains(".coefficients.") {
                text.replace(['-', '.'], "").trim_start_matches('0').len() <= 9
            } else {
                // Coefficients per ampere have one more decimal, because they are multiplied by up to 100 A.
                let is_small = path.contains("soft_iron") || path.ends_with("ut_per_a");
                decimals <= 3 + usize::from(is_small) + 2 * usize::from(path.contains(".matrix"))
            };
            assert!(is_good && !text.contains('e'), "{path}: {text}");
        }
        _ => {}
    }
}

fn assert_schema(section: &str, outputs: &[Value]) {
    let mut output_paths = BTreeSet::new();
    for output in outputs {
        assert_digits(output, "");
        collect_json_paths(output, "", &mut output_paths);
    }
    let documented = documented_paths(section);
    for path in &output_paths {
        let is_documented = match path.strip_suffix('?') {
            Some(path) => documented.iter().any(|candidate_path| is_replaced_by_null(path, candidate_path)),
            None => documented.iter().any(|candidate_path| matches_documented_path(path, candidate_path)),
        };
        assert!(is_documented, "{section}: {path} is not in docs/json-fields.txt");
    }
    for path in documented {
        assert!(
            output_paths.iter().any(|candidate_path| matches_documented_path(candidate_path, &path)),
            "{section}: {path} of docs/json-fields.txt is not in the output"
        );
    }
}

fn json_output(arguments: &str) -> Value {
    let stdout_text = stdout_text(arguments);
    assert_eq!(stdout_text.lines().count(), 1, "{arguments}");
    serde_json::from_str(&stdout_text).unwrap()
}

/// Table of an inertial sensor that wobbles on a desk for five seconds.
fn resting_trial() -> String {
    let header = "t_s,p_dps,q_dps,r_dps,ax_mps2,ay_mps2,az_mps2,mx_ut,my_ut,mz_ut,roll_ref_deg,pitch_ref_deg,\
                  yaw_ref_deg,moving\n";
    let rows = (0..1000_u32).map(|i| {
        let wobble = f64::from(i % 7) * 0.01;
        format!("{},{wobble},-{wobble},{wobble},{wobble},0,-9.8,20,{wobble},43,0,0,0,1\n", f64::from(i) * 0.005)
    });
    header.to_owned() + &rows.collect::<String>()
}

#[test]
fn json_output_is_documented() {
    let refused = json_output("fly --json --circles 0.1");
    assert_eq!((&refused["accepted"], &refused["after"]), (&Value::Bool(false), &Value::Null));
    assert_schema("fly --json", &[json_output("fly --json"), refused]);
    assert_schema("table1 --json", &[json_output("table1 --json")]);
    let whole_flights = json_output("bench accuracy --aircraft copter --airframes 1 --draws 1 --minutes 1 --json");
    assert_schema(
        "bench accuracy --json",
        &[json_output("bench accuracy --airframes 1 --draws 1 --json"), whole_flights],
    );
    // Cases: a rejected calibration, missing headings, a hard-iron change.
    let cases = ["cal-bank-5", "stuck-all", "moved-5"].map(|name| format!("--case {name} ")).concat();
    assert_schema("bench integrity --json", &[json_output(&format!("bench integrity --flights 1 {cases}--json"))]);
    let folder = tempfile::tempdir().unwrap();
    let trial = folder.path().join("trial.csv");
    fs::write(&trial, resting_trial()).unwrap();
    assert_schema("bench imu --json", &[json_output(&format!("bench imu --json {}", trial.display()))]);
    assert_schema("bench speed --json", &[json_output("bench speed --json")]);
    let flight = json_output("replay host-sim/data/flight.csv --json");
    assert_digits(&flight, "");
    let text = documents::document_text("docs/json.md");
    let mut output_paths = BTreeSet::new();
    collect_json_paths(&flight, "", &mut output_paths);
    // The keys of `log.passed_over` are causes, not documented names.
    for path in output_paths.into_iter().filter(|path| !path.starts_with("log.passed_over.")) {
        let name = path.trim_end_matches(['?', '[', ']']).rsplit('.').next().unwrap().to_owned();
        assert!(text.contains(&format!("`{name}`")) || text.contains(&format!("`.{name}`")), "{path}: docs/json.md");
    }
}

#[test]
fn json_output_of_serve_is_documented() {
    let startup_output = |arguments: &str| {
        let mut child = host_sim_command(arguments).spawn().unwrap();
        let mut line = String::new();
        io::BufRead::read_line(&mut io::BufReader::new(child.stdout.take().unwrap()), &mut line).unwrap();
        // The program ends because its standard input is closed.
        child.wait().unwrap();
        serde_json::from_str(&line).unwrap()
    };
    assert_schema(
        "serve --json",
        &[startup_output("serve --json"), startup_output("serve --json --tcp 0 --world 0 --can mcast:9")],
    );
}

#[test]
#[ignore = "needs qemu-system-arm and scripts/build-firmware"]
fn instructions_stay_within_their_budgets_and_the_json_of_them_is_documented() {
    let (code, stdout_text, stderr_text) = run_command("bench budget --json");
    println!("{stdout_text}");
    assert_eq!(code, Some(0), "{stderr_text}");
    let output: Value = serde_json::from_str(&stdout_text).unwrap();
    for budget in output["budgets"].as_array().unwrap() {
        assert!(budget["counted"].as_u64().unwrap() <= budget["limit"].as_u64().unwrap(), "{budget}");
    }
    assert_schema("bench budget --json", &[output]);
}

/// A log without an extension in a subfolder, a blackbox of two flights, a damaged log, and no log.
#[test]
fn a_folder_gives_a_line_for_each_log_in_it() {
    let folder = tempfile::tempdir().unwrap();
    let path_in_folder = |name: &str| folder.path().join(name);
    let blackbox = encode_blackbox(&record_turns(&WorldConfig::of_table1(1), 0.0));
    fs::create_dir(path_in_folder("day")).unwrap();
    fs::copy(repository_root().join("host-sim/data/flight.csv"), path_in_folder("day/1")).unwrap();
    for (name, bytes) in
        [("LOG.TXT", [&blackbox[..], &blackbox].concat()), ("a.BIN", vec![0; 99]), ("notes.txt", b"windy".to_vec())]
    {
        fs::write(path_in_folder(name), bytes).unwrap();
    }
    let (code, stdout_text, stderr_text) = run_command(&format!("replay --json {}", folder.path().display()));
    let mut names: Vec<String> = stdout_text
        .lines()
        .map(|line| serde_json::from_str::<Value>(line).unwrap()["file"].as_str().unwrap().to_owned())
        .map(|file| file.rsplit_once(&format!("{}/", folder.path().display())).unwrap().1.to_owned())
        .collect();
    names.sort();
    assert_eq!(names, ["LOG.TXT/flight 1", "LOG.TXT/flight 2", "a.BIN", "day/1"], "{stderr_text}");
    assert_eq!(code, Some(2), "{stderr_text}");
    let (_, stdout_text, _) = run_command(&format!("replay {}", path_in_folder("LOG.TXT").display()));
    assert_eq!(stdout_text.lines().count(), 2, "{stdout_text}");
}

#[test]
fn the_report_is_of_the_log_that_is_named_after_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let path_in_folder = |name: &str| folder.path().join(name);
    let [first, second] = [1, 2].map(|seed| encode_blackbox(&record_turns(&WorldConfig::of_table1(seed), 0.0)));
    fs::write(path_in_folder("LOG.TXT"), [&first[..], &second].concat()).unwrap();
    fs::write(path_in_folder("second.TXT"), &second).unwrap();
    let report_of = |name: &str| {
        let mut command = host_sim_command("replay --json --report");
        command.arg(path_in_folder("r.svg")).arg(path_in_folder(name));
        let Output { stdout, stderr, .. } = command.output().unwrap();
        let picture = fs::read_to_string(path_in_folder("r.svg")).unwrap_or_default();
        let _ = fs::remove_file(path_in_folder("r.svg"));
        (picture, [stdout, stderr].map(|bytes| String::from_utf8(bytes).unwrap()))
    };
    let (picture, [json, _]) = report_of("LOG.TXT/flight 2");
    assert!(picture.starts_with("<svg"), "{json}");
    assert_eq!(json, report_of("second.TXT").1[0]);
    for (name, cause) in [("LOG.TXT", "several-logs: "), ("LOG.TXT/flight 3", "no-such-log: ")] {
        let (picture, [_, error]) = report_of(name);
        let has_names = error.contains("LOG.TXT/flight 1, ") && error.contains("LOG.TXT/flight 2");
        assert!(picture.is_empty() && error.contains(cause) && has_names, "{error}");
    }
}

const TABLE: &str = "replay host-sim/data/flight.csv";

#[test]
fn command_errors_are_reported_with_a_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    fs::write(&file, "no firmware, no log").unwrap();
    let file = file.display();
    for (arguments, cause, what_to_do) in [
        (
            format!("emulate --image {file}"),
            format!("{file} is no firmware: it is too short"),
            "scripts/build-firmware",
        ),
        (
            "emulate --image Cargo.toml".to_owned(),
            "Cargo.toml is no firmware: it is no ELF".to_owned(),
            "scripts/build",
        ),
        ("bench budget --image README.md".to_owned(), "README.md is no firmware".to_owned(), "scripts/build-firmware"),
        ("emulate --image /nowhere.elf".to_owned(), "/nowhere.elf".to_owned(), "scripts/build-firmware"),
        ("replay /nowhere.bin".to_owned(), "/nowhere.bin".to_owned(), "give the path of a log"),
        (format!("replay {file}"), format!("unknown-format: {file}: not a known log"), ""),
        ("replay /dev/null".to_owned(), "empty-file: /dev/null: the file is empty".to_owned(), ""),
        (format!("{TABLE} --from 500 --to 200"), "reversed-time-range: ".to_owned(), "ends before it begins"),
        (format!("{TABLE} --from 5000"), "time-range-outside-log: ".to_owned(), "it has 0 to 200 s"),
        (format!("{TABLE} --from 60 --to 61"), "few-rows-in-time-range: ".to_owned(), "choose a longer part"),
        (format!("{TABLE} --compass 8"), "no-such-compass: ".to_owned(), "it has 1"),
        (format!("{TABLE} --reference gps-yaw"), "no-such-reference: ".to_owned(), "it has column"),
        ("flight.BIN".to_owned(), "flight.BIN is a log".to_owned(), "lab replay flight.BIN"),
        (format!("fly --circles 0.1 --report {file}.pdf"), "a report is .html or .svg".to_owned(), "names another"),
        ("fly --airframe /nowhere.toml".to_owned(), "/nowhere.toml".to_owned(), "expected"),
        ("fly --json --circles 0.1 --record /nowhere/x.csv".to_owned(), "/nowhere/x.csv".to_owned(), "--record names"),
        (format!("{TABLE} --report /nowhere/of/page.html"), "/nowhere does not exist".to_owned(), "names another"),
        (format!("fly --circles 0.1 --report {file}"), file.to_string(), "--report names another file or folder"),
        ("bench integrity --case none".to_owned(), "no case none".to_owned(), "--case list shows all"),
    ] {
        let (code, _, stderr_text) = run_command(&arguments);
        assert_eq!(code, Some(2), "{arguments}: {stderr_text}");
        assert!(stderr_text.contains(&cause) && stderr_text.contains(what_to_do), "{arguments}: {stderr_text}");
    }
}

/// A terminal of a width, and the thread that reads its output.
fn open_terminal(columns: u16) -> (File, thread::JoinHandle<String>) {
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let name = ptsname(&master, Vec::new()).unwrap();
    let terminal = File::options().write(true).open(name.to_str().unwrap()).unwrap();
    let size = rustix::termios::Winsize { ws_row: 24, ws_col: columns, ws_xpixel: 0, ws_ypixel: 0 };
    rustix::termios::tcsetwinsize(&terminal, size).unwrap();
    let displayed_text = thread::spawn(move || {
        let (mut master, mut displayed_text) = (File::from(master), Vec::new());
        // The end of a pseudo-terminal is reported as an error.
        let _ = master.read_to_end(&mut displayed_text);
        String::from_utf8_lossy(&displayed_text).into_owned()
    });
    (terminal, displayed_text)
}

/// The last characters return to the start of the line and erase it.
#[test]
fn ctrl_c_removes_the_progress_bar() {
    let (terminal, displayed_text) = open_terminal(80);
    let arguments = "bench accuracy --airframes 1000000";
    let mut child = host_sim_command(arguments).stdout(Stdio::null()).stderr(terminal).spawn().unwrap();
    wait_for_interrupt_handler(child.id());
    thread::sleep(Duration::from_millis(500));
    assert_eq!(interrupt_for_exit_code(&mut child), Some(130));
    let displayed_text = displayed_text.join().unwrap();
    assert!(displayed_text.contains("airframes") && displayed_text.ends_with("\r\u{1b}[2K"), "{displayed_text:?}");
}

#[test]
fn text_fits_a_narrow_terminal() {
    for arguments in ["replay --verbose host-sim/data/flight.csv", "serve --help"] {
        let (terminal, displayed_text) = open_terminal(60);
        host_sim_command(arguments).stdout(terminal).stderr(Stdio::null()).status().unwrap();
        let displayed_text = displayed_text.join().unwrap();
        // Escape sequences of bold text have no width; a command to copy is not wrapped.
        for line in displayed_text.lines().filter(|line| !line.contains('\u{1b}') && !line.contains(": lab replay ")) {
            assert!(line.chars().count() <= 60, "{arguments}: {line}");
        }
        assert!(displayed_text.lines().count() > 10, "{arguments}: {displayed_text}");
    }
}

#[test]
fn progress_is_shown_on_a_terminal_only() {
    for (arguments, label) in [
        ("bench accuracy --airframes 2 --draws 1", "airframes"),
        ("bench integrity --flights 1 --case clean", "flights"),
        ("replay host-sim/data/flight.csv", "evaluating the compasses"),
        ("fly --json --circles 0.1", "take-off"),
    ] {
        let (terminal, displayed_text) = open_terminal(80);
        let child = host_sim_command(arguments).stderr(terminal).spawn().unwrap();
        let Output { stdout, .. } = child.wait_with_output().unwrap();
        let displayed_text = displayed_text.join().unwrap().to_lowercase();
        assert!(displayed_text.contains(label), "{arguments}: {displayed_text:?}");
        let (_, stdout_text, stderr_text) = run_command(arguments);
        assert_eq!(String::from_utf8_lossy(&stdout), stdout_text, "{arguments}: the same bytes");
        assert_eq!(stderr_text, "", "{arguments}: on no terminal");
    }
}

#[test]
fn the_airframe_of_a_seed_is_printed_as_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let (report, path) = (folder.path().join("report"), folder.path().join("seven.toml"));
    let text = stdout_text(&format!("fly --airframe random --seed 7 --circles 0.1 --report {}", report.display()));
    let (_, file) = text.split_once("the airframe of this seed, as a file for --airframe:\n\n").unwrap();
    fs::write(&path, file).unwrap();
    let printed_airframe = json_output("fly --airframe random --seed 7 --circles 0.1 --json");
    let from_file = json_output(&format!("fly --airframe {} --seed 7 --circles 0.1 --json", path.display()));
    for name in ["rms_deg", "max_deg"] {
        let [printed_airframe, from_file] =
            [&printed_airframe, &from_file].map(|output| output["before"][name].as_f64().unwrap());
        // The matrix is rounded to 0.0001, the mounting to 0.01 deg.
        assert!((printed_airframe - from_file).abs() < 0.05, "{name}: {printed_airframe} {from_file}");
    }
    let [printed_airframe, from_file] =
        [&printed_airframe, &from_file].map(|output| output["airframe"]["total_ut"].as_f64().unwrap());
    assert!((printed_airframe - from_file).abs() < 0.01, "{printed_airframe} {from_file}");
    let expected_text = stdout_text(&format!("fly --circles 0.1 --report {}", report.display()));
    assert!(!expected_text.contains("soft_iron"), "the paper's is known");
}

/// A table in the axes of a sensor that is turned by 90 deg has the result of the table in body axes.
#[test]
fn a_table_of_a_turned_sensor_is_judged_with_its_mount() {
    let table = fs::read_to_string(repository_root().join("host-sim/data/flight.csv")).unwrap();
    let mut lines = table.lines().filter(|line| !line.starts_with('#'));
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let [x, y] = ["mx", "my"].map(|column_name| names.iter().position(|name| *name == column_name).unwrap());
    // yaw90: the sensor's x axis points right, its y axis back.
    let turned_lines = lines.map(|line| {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        let (forward_ut, right_ut) = (cells[x].clone(), cells[y].clone());
        cells[x] = right_ut;
        cells[y] = forward_ut.strip_prefix('-').map_or_else(|| format!("-{forward_ut}"), str::to_owned);
        cells.join(",")
    });
    let text = std::iter::once(names.join(",")).chain(turned_lines).collect::<Vec<_>>().join("\n");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("turned.csv");
    fs::write(&path, text).unwrap();
    let path = path.to_str().unwrap();
    let json = |words: &[&str]| {
        let (_, stdout, stderr) = run_command(&words.join(" "));
        let json: Value = serde_json::from_str(&stdout).unwrap_or_else(|error| panic!("{error}: {stderr}"));
        json["compasses"].clone()
    };
    let straight = json(&["replay host-sim/data/flight.csv --json"]);
    assert_eq!(straight, json(&["replay", path, "--mount yaw90 --json"]));
    assert_ne!(straight, json(&["replay", path, "--json"]));
}

/// Lines of `--out` have the time stamps of the log, and can be joined to it, although the field is 50 ms older.
#[test]
fn headings_are_written_at_the_time_stamps_of_the_log() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("headings.csv");
    let arguments = format!("replay host-sim/data/flight.csv --age 50 --out {}", path.display());
    let (_, _, stderr) = run_command(&arguments);
    let written = fs::read_to_string(&path).unwrap_or_else(|error| panic!("{error}: {stderr}"));
    let stamps_s = |text: &str| -> Vec<f64> {
        let lines = text.lines().filter(|line| !line.starts_with('#')).skip(1);
        lines.map(|line| line.split(',').next().unwrap().parse().unwrap()).collect()
    };
    let table = fs::read_to_string(repository_root().join("host-sim/data/flight.csv")).unwrap();
    assert_eq!(stamps_s(&written), stamps_s(&table));
    let averaged = written.lines().filter(|line| line.ends_with(",1")).count();
    assert!(averaged * 10 > written.lines().count() * 9, "{averaged}: each reading is one row");
}

/// The table of the repository with two more compasses, each of them bad.
fn table_of_three_compasses() -> String {
    let table = fs::read_to_string(repository_root().join("host-sim/data/flight.csv")).unwrap();
    let mut lines = table.lines().filter(|line| !line.starts_with('#'));
    let names = lines.next().unwrap();
    let columns: Vec<usize> =
        ["mx", "my", "mz"].map(|name| names.split(',').position(|column| column == name).unwrap()).to_vec();
    let rows = lines.map(|line| {
        let cells: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap_or(0.0)).collect();
        let further: Vec<String> = [40.0, -90.0]
            .iter()
            .flat_map(|offset| columns.iter().map(move |column| (column, offset)))
            .map(|(column, offset)| (cells[*column] + offset).to_string())
            .collect();
        format!("{line},{}\n", further.join(","))
    });
    format!("{names},mx2,my2,mz2,mx3,my3,mz3\n{}", rows.collect::<String>())
}

/// A terminal of 80 columns and 24 lines, the last of which has the prompt, shows the verdict on three compasses whole;
/// the commands that go on are last.
#[test]
fn the_verdict_on_three_compasses_fits_a_terminal() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("three.csv");
    fs::write(&path, table_of_three_compasses()).unwrap();
    let (terminal, displayed_text) = open_terminal(80);
    let arguments = format!("replay {}", path.display());
    host_sim_command(&arguments)
        .env_remove("NO_COLOR")
        .env("TERM", "xterm")
        .stdout(terminal)
        .stderr(Stdio::null())
        .status()
        .unwrap();
    let displayed_text = displayed_text.join().unwrap();
    let lines: Vec<&str> = displayed_text.trim_end().lines().collect();
    assert!(lines.len() < 24, "{displayed_text}");
    assert_eq!(displayed_text.matches("\u{1b}[1m\u{1b}[31mBAD\u{1b}[0m: Compass").count(), 3, "{displayed_text:?}");
    assert!(lines[lines.len() - 2].contains("--params compass.param"), "{displayed_text}");
    // Neither a pipe nor a terminal with NO_COLOR has colours.
    let plain = stdout_text(&arguments);
    assert!(plain.contains("BAD: Compass 1") && !plain.contains('\u{1b}'), "{plain:?}");
    assert!(stdout_text(&format!("{arguments} --color always")).contains("\u{1b}[31m"));
}

/// QGroundControl loads five columns separated by tabs; the other ground stations name and value.
#[test]
fn a_parameter_file_has_the_columns_of_its_extension_and_the_old_values() {
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("flight.bin");
    json_output(&format!("fly --json --record {}", log.display()));
    let written = |name: &str| {
        let path = folder.path().join(name);
        run_command(&format!("replay {} --params {}", log.display(), path.display()));
        fs::read_to_string(path).unwrap()
    };
    let (pairs, columns) = (written("compass.param"), written("compass.params"));
    let values = |text: &str, separator: char| -> Vec<(String, String)> {
        let lines = text.lines().filter(|line| !line.starts_with('#'));
        let cells = lines.map(|line| line.split(separator).map(str::to_owned).collect::<Vec<_>>());
        cells.map(|cells| (cells[cells.len() / 4 * 2].clone(), cells[cells.len() / 4 * 2 + 1].clone())).collect()
    };
    assert_eq!(values(&pairs, ','), values(&columns, '\t'));
    assert!(columns.lines().any(|line| line.starts_with("1\t1\tCOMPASS_OFS_X\t") && line.ends_with("\t9")));
    assert!(columns.lines().any(|line| line.starts_with("1\t1\tCOMPASS_ORIENT\t") && line.ends_with("\t2")));
    for text in [&pairs, &columns] {
        assert!(text.contains("\n# COMPASS_OFS_X 0\n"), "{text}");
    }
}
