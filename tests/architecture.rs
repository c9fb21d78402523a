//! The rules of `src/`: which floor may use which, what only the edges touch, what is nowhere. A rule that is broken
//! is reported with file, line and reason.
//!
//! Comment lines are no uses. Test-only code (what stands under `#[cfg(test)]`, in the same file or in the files that
//! such a `mod` names) may use any floor, threads, files and the clock: it runs nowhere but on the maker's machine. The
//! rules on length, prose, hash tables, unfinished code and paths hold for it too.

use std::collections::BTreeSet;
use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};

/// The floors, highest in the order of use first: a floor uses those before it, never those after it.
const FLOORS: [&str; 17] = [
    "monitor",
    "geometry",
    "camera",
    "imaging",
    "targets",
    "adjustment",
    "orientation",
    "matching",
    "network",
    "plain_network",
    "synthetic",
    "stages",
    "report",
    "project",
    "commands",
    "worker",
    "ui",
];

/// Floors that stand before another but are not for it, with the reason.
const STRANGERS: [(&str, &[&str], &str); 8] = [
    (
        "geometry",
        &["monitor"],
        "geometry is plain mathematics and uses nothing of the crate",
    ),
    (
        "camera",
        &["monitor"],
        "a camera computes one projection, too short to be interrupted",
    ),
    (
        "adjustment",
        &["imaging", "targets"],
        "an adjustment sees numbers, no pictures",
    ),
    (
        "orientation",
        &["imaging", "targets", "adjustment"],
        "orientation sees numbers, no pictures",
    ),
    (
        "matching",
        &["imaging", "targets", "adjustment", "orientation"],
        "matching sees numbers, no pictures",
    ),
    (
        "network",
        &["imaging", "adjustment", "orientation", "matching"],
        "the network holds values, it computes nothing",
    ),
    (
        "plain_network",
        &["imaging", "targets"],
        "a network without pictures",
    ),
    (
        "synthetic",
        &[
            "adjustment",
            "orientation",
            "matching",
            "network",
            "plain_network",
        ],
        "truth must not come from what it tests",
    ),
];

const LONGEST_FILE: usize = 600;

/// A text that only some places may hold.
struct Reserved {
    texts: &'static [&'static str],
    /// Folders (ending in `/`) and files under `src/` where it may stand; none: nowhere.
    places: &'static [&'static str],
    scope: Scope,
    why: &'static str,
}

#[derive(Clone, Copy, PartialEq)]
enum Scope {
    /// Code of the program.
    Program,
    /// Code of the program and of its tests.
    Code,
    /// Every line, comments too.
    Everything,
}

const EDGES: &[&str] = &[
    "commands/",
    "project/",
    "worker.rs",
    "ui/window.rs",
    "main.rs",
];

const RESERVED: [Reserved; 9] = [
    Reserved {
        texts: &[
            "std::fs",
            "fs::read",
            "fs::write",
            "File::open",
            "File::create",
        ],
        places: &[
            "imaging/load.rs",
            "project/",
            "report/",
            "commands/",
            "main.rs",
        ],
        scope: Scope::Program,
        why: "files are touched at the edges only",
    },
    Reserved {
        texts: &[
            "std::thread",
            "thread::spawn",
            "thread::scope",
            "Instant",
            "SystemTime",
            "std::env",
            "env::var",
        ],
        places: EDGES,
        scope: Scope::Program,
        why: "threads, clock and environment stay at the edges, so that a stage gives the same digits everywhere",
    },
    Reserved {
        texts: &[
            "rand::rng(",
            "thread_rng",
            "ThreadRng",
            "rand::random",
            "OsRng",
            "SysRng",
            "from_os_rng",
            "from_entropy",
            "try_from_rng",
            "make_rng",
        ],
        places: &[],
        scope: Scope::Code,
        why: "random numbers come from a seed in the settings",
    },
    Reserved {
        texts: &["rayon"],
        places: &[
            "imaging/",
            "targets/",
            "adjustment/",
            "matching/",
            "synthetic/",
            "stages/",
            "project/intake.rs",
            "commands/demo.rs",
        ],
        scope: Scope::Program,
        why: "work is shared among threads in few places, each of which keeps the order of sums",
    },
    Reserved {
        texts: &["HashMap", "HashSet", "RandomState"],
        places: &[],
        scope: Scope::Code,
        why: "the order of a hash table changes from run to run: BTreeMap, BTreeSet",
    },
    Reserved {
        texts: &["todo!", "unimplemented!", "dbg!"],
        places: &[],
        scope: Scope::Code,
        why: "nothing unfinished",
    },
    Reserved {
        texts: &["#[ignore"],
        places: &[],
        scope: Scope::Code,
        why: "no test that does not run",
    },
    Reserved {
        texts: &["crate::{", "std::{", "super::super::super"],
        places: &[],
        scope: Scope::Code,
        why: "one module a `use` line, so that these rules can be read off the text",
    },
    Reserved {
        texts: &["/home/", "/root/", "/tmp/", "/mnt/"],
        places: &[],
        scope: Scope::Everything,
        why: "no path of one machine",
    },
];

struct Source {
    /// Path under `src/`, with forward slashes.
    path: String,
    lines: Vec<String>,
}

#[derive(Debug, PartialEq)]
struct Violation {
    path: String,
    line: usize,
    rule: String,
}

impl fmt::Display for Violation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "src/{}:{}: {}", self.path, self.line, self.rule)
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Comment,
    Program,
    Test,
}

impl Source {
    fn new(path: &str, text: &str) -> Self {
        Self {
            path: path.to_owned(),
            lines: text.lines().map(str::to_owned).collect(),
        }
    }

    fn is_under(&self, places: &[&str]) -> bool {
        places.iter().any(|place| {
            self.path == *place || (place.ends_with('/') && self.path.starts_with(place))
        })
    }

    fn floor(&self) -> &str {
        self.path.split(['/', '.']).next().unwrap_or_default()
    }

    /// Files and folders that hold the modules declared under `#[cfg(test)]` here.
    fn test_modules(&self) -> Vec<String> {
        let folder = self.path.rsplit_once('/').map_or("", |(folder, _)| folder);
        let join = |a: &str, b: &str| {
            if a.is_empty() {
                b.to_owned()
            } else {
                format!("{a}/{b}")
            }
        };
        let own = self.path.trim_end_matches(".rs");
        let children = match own.rsplit('/').next() {
            Some("mod" | "lib" | "main") => folder.to_owned(),
            _ => own.to_owned(),
        };
        let mut found = Vec::new();
        for start in self.test_attributes() {
            let mut named = None;
            for line in self.lines[start + 1..].iter().map(|line| line.trim()) {
                if let Some(path) = line.strip_prefix("#[path = \"") {
                    named = path.split('"').next();
                } else if !line.starts_with("#[") {
                    let declared = line
                        .strip_suffix(';')
                        .and_then(|line| line.rsplit_once("mod "))
                        .map(|(_, name)| name);
                    match (declared, named) {
                        (Some(_), Some(path)) => found.push(join(folder, path)),
                        (Some(name), None) => {
                            found.push(join(&children, &format!("{name}.rs")));
                            found.push(join(&children, &format!("{name}/")));
                        }
                        (None, _) => {}
                    }
                    break;
                }
            }
        }
        found
    }

    fn test_attributes(&self) -> Vec<usize> {
        (0..self.lines.len())
            .filter(|&index| self.lines[index].trim() == "#[cfg(test)]")
            .collect()
    }

    /// What each line is; `tests`: all of this file is test code.
    fn kinds(&self, tests: bool) -> Vec<Kind> {
        let mut kinds: Vec<Kind> = self
            .lines
            .iter()
            .map(|line| match line.trim_start().starts_with("//") {
                true => Kind::Comment,
                false if tests => Kind::Test,
                false => Kind::Program,
            })
            .collect();
        for start in self.test_attributes() {
            let indent = self.lines[start].len() - self.lines[start].trim_start().len();
            let end = (start + 1..self.lines.len()).find(|&index| {
                let line = &self.lines[index];
                let text = line.trim();
                let depth = line.len() - line.trim_start().len();
                depth == indent
                    && (text.ends_with(';') || text.ends_with('}'))
                    && !text.starts_with("#[")
            });
            for kind in &mut kinds[start..=end.unwrap_or(start)] {
                if *kind == Kind::Program {
                    *kind = Kind::Test;
                }
            }
        }
        kinds
    }
}

/// All broken rules of these files.
fn violations(sources: &[Source]) -> Vec<Violation> {
    let tests: BTreeSet<String> = sources.iter().flat_map(Source::test_modules).collect();
    let tests: Vec<&str> = tests.iter().map(String::as_str).collect();
    let mut found = Vec::new();
    for source in sources {
        let kinds = source.kinds(source.is_under(&tests));
        let mut report = |line: usize, rule: String| {
            found.push(Violation {
                path: source.path.clone(),
                line: line + 1,
                rule,
            });
        };
        for (index, line) in source.lines.iter().enumerate() {
            if kinds[index] == Kind::Program {
                for used in floors_used(code_of(line)) {
                    if let Some(rule) = forbidden_use(source.floor(), used) {
                        report(index, rule);
                    }
                }
            }
            for reserved in &RESERVED {
                let applies = match reserved.scope {
                    Scope::Program => kinds[index] == Kind::Program,
                    Scope::Code => kinds[index] != Kind::Comment,
                    Scope::Everything => true,
                };
                let read = match reserved.scope {
                    Scope::Everything => line.as_str(),
                    Scope::Program | Scope::Code => code_of(line),
                };
                if applies && !source.is_under(reserved.places) {
                    for text in reserved.texts.iter().filter(|text| names(read, text)) {
                        report(index, format!("`{text}`: {}", reserved.why));
                    }
                }
            }
            if source.path == "lib.rs" && line.trim_start().starts_with("pub use") {
                report(
                    index,
                    "lib.rs re-exports nothing: a path says where to look".into(),
                );
            }
        }
        if source.path.ends_with("mod.rs") || source.path == "lib.rs" {
            let prose = source
                .lines
                .first()
                .is_some_and(|line| line.starts_with("//! "));
            if !prose {
                report(0, "a folder's mod.rs begins with its prose (`//!`)".into());
            }
        }
        if source.lines.len() > LONGEST_FILE {
            let rule = format!(
                "{} lines, at most {LONGEST_FILE}: one idea a file",
                source.lines.len()
            );
            report(LONGEST_FILE, rule);
        }
    }
    found
}

/// A line without the comment at its end.
fn code_of(line: &str) -> &str {
    line.split_once(" // ").map_or(line, |(code, _)| code)
}

/// Whether a line holds a text that is not the end or the beginning of a longer word.
fn names(line: &str, text: &str) -> bool {
    let of_word = |c: char| c.is_alphanumeric() || c == '_';
    line.match_indices(text).any(|(at, _)| {
        let before = line[..at].chars().next_back();
        let after = line[at + text.len()..].chars().next();
        let opens = text.starts_with(of_word) || text.starts_with('/');
        let closes = text.ends_with(of_word);
        !(opens && before.is_some_and(of_word) || closes && after.is_some_and(of_word))
    })
}

/// The floors that a line names after `crate::`.
fn floors_used(line: &str) -> Vec<&'static str> {
    FLOORS
        .into_iter()
        .filter(|floor| {
            names(line, &format!("crate::{floor}")) || names(line, &format!("tiepoint::{floor}"))
        })
        .collect()
}

fn forbidden_use(floor: &str, used: &str) -> Option<String> {
    let place = |name: &str| FLOORS.iter().position(|f| *f == name);
    // lib.rs and main.rs are no floors: they may name all.
    let (own, other) = (place(floor)?, place(used)?);
    if other > own {
        return Some(format!("{floor} uses {used}, a floor below it"));
    }
    STRANGERS
        .iter()
        .find(|(name, strangers, _)| *name == floor && strangers.contains(&used))
        .map(|(.., why)| format!("{floor} uses {used}: {why}"))
}

fn sources() -> Vec<Source> {
    fn gather(folder: &Path, files: &mut Vec<PathBuf>) {
        let entries = fs::read_dir(folder).expect("a folder under src");
        for entry in entries {
            let path = entry.expect("an entry of a folder").path();
            if path.is_dir() {
                gather(&path, files);
            } else if path.extension().is_some_and(|e| e == "rs") {
                files.push(path);
            }
        }
    }
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    gather(&root, &mut files);
    files.sort();
    files
        .iter()
        .map(|path| {
            let text = fs::read_to_string(path).expect("a source file");
            let inside = path.strip_prefix(&root).expect("a path under src");
            Source::new(&inside.to_string_lossy().replace('\\', "/"), &text)
        })
        .collect()
}

#[test]
fn the_source_keeps_its_rules() {
    let sources = sources();
    assert!(sources.len() > 100, "found {} source files", sources.len());
    let broken: Vec<String> = violations(&sources)
        .iter()
        .map(ToString::to_string)
        .collect();
    assert!(
        broken.is_empty(),
        "{} rules broken:\n{}",
        broken.len(),
        broken.join("\n")
    );
}

#[test]
fn every_folder_is_a_floor() {
    let folders: BTreeSet<String> = sources()
        .iter()
        .map(|source| source.floor().to_owned())
        .filter(|name| !["lib", "main"].contains(&name.as_str()))
        .collect();
    let floors: BTreeSet<String> = FLOORS.iter().map(ToString::to_string).collect();
    assert_eq!(folders, floors);
}

#[test]
fn every_rule_can_be_broken() {
    let long = "\n".repeat(LONGEST_FILE + 1);
    for (path, text, line) in [
        ("geometry/pose.rs", "use crate::camera::Camera;", 1),
        ("geometry/pose.rs", "use crate::monitor::Monitor;", 1),
        (
            "targets/dot.rs",
            "\nfn f(a: crate::adjustment::Datum) {}",
            2,
        ),
        ("adjustment/solver.rs", "use crate::targets::Dot;", 1),
        ("orientation/p3p.rs", "use crate::network::ImageId;", 1),
        ("matching/sight.rs", "use crate::imaging::GreyImage;", 1),
        (
            "stages/mod.rs",
            "//! Stages.\nuse crate::report::RunSummary;",
            2,
        ),
        (
            "stages/mod.rs",
            "//! Stages.\nuse crate::{report, geometry};",
            2,
        ),
        ("stages/detect.rs", "use std::fs;", 1),
        (
            "stages/detect.rs",
            "let begun = std::time::Instant::now();",
            1,
        ),
        ("imaging/noise.rs", "std::thread::sleep(pause);", 1),
        ("imaging/load.rs", "let home = std::env::var(\"HOME\");", 1),
        ("synthetic/noise.rs", "let mut random = rand::rng();", 1),
        ("orientation/dlt.rs", "use rayon::prelude::*;", 1),
        (
            "network/mod.rs",
            "//! Names.\nuse std::collections::HashMap;",
            2,
        ),
        ("commands/run.rs", "    todo!()", 1),
        ("commands/run.rs", "#[ignore = \"slow\"]", 1),
        ("commands/run.rs", "// see /home/somebody/notes", 1),
        ("lib.rs", "//! The map.\npub use geometry::Pose;", 2),
        ("camera/mod.rs", "mod interior;", 1),
        ("camera/interior.rs", long.as_str(), LONGEST_FILE + 1),
    ] {
        let found = violations(&[Source::new(path, text)]);
        let places: Vec<(&str, usize)> = found.iter().map(|v| (v.path.as_str(), v.line)).collect();
        assert!(
            places.contains(&(path, line)),
            "{path}: {text:?}: {found:?}"
        );
    }
}

#[test]
fn what_is_allowed_is_not_reported() {
    let source = |path, text| Source::new(path, text);
    let allowed = [
        source(
            "stages/mod.rs",
            "//! Prose on crate::report.\n// rayon, std::fs\nuse crate::geometry::Pose;\n",
        ),
        source(
            "geometry/pose.rs",
            "fn f() {}\n\n#[cfg(test)]\nmod tests {\n    use crate::camera::Camera;\n}\n",
        ),
        source(
            "adjustment/mod.rs",
            "//! Prose.\n\n#[cfg(test)]\nmod simulation;\n",
        ),
        source(
            "adjustment/simulation.rs",
            "use rayon::prelude::*;\nuse crate::synthetic::panel;\n",
        ),
        source(
            "targets/detect.rs",
            "#[cfg(test)]\n#[path = \"detect_tests.rs\"]\nmod tests;\n",
        ),
        source("targets/detect_tests.rs", "use crate::synthetic::panel;\n"),
        source(
            "report/file.rs",
            "use std::fs;\nlet inner_todo = 1; // Instant\nlet network_path = \"a/workshop\";",
        ),
    ];
    assert_eq!(violations(&allowed), []);
}
