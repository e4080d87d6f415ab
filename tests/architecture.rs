//! Who may depend on whom: crates by their manifests, modules by their code.

use crate::program::repository;
use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

/// Every crate by its folder, with the crates of this project that it stands on. Each stands on crates above it alone.
const ARROWS: [(&str, &[&str]); 27] = [
    ("engine/document", &[]),
    ("engine/contract", &["document"]),
    ("engine/statistics", &["contract", "document"]),
    ("engine/execution", &["contract", "document"]),
    ("engine/analysis", &["contract", "document", "statistics"]),
    (
        "engine/imported",
        &["analysis", "contract", "document", "execution", "statistics"],
    ),
    (
        "engine/presentation",
        &["analysis", "contract", "document", "statistics"],
    ),
    (
        "engine/study",
        &[
            "analysis",
            "contract",
            "document",
            "execution",
            "imported",
            "presentation",
            "statistics",
        ],
    ),
    (
        "engine/report",
        &[
            "analysis",
            "contract",
            "document",
            "execution",
            "imported",
            "presentation",
            "statistics",
            "study",
        ],
    ),
    (
        "engine/session",
        &[
            "analysis",
            "contract",
            "document",
            "execution",
            "imported",
            "presentation",
            "report",
            "statistics",
            "study",
        ],
    ),
    (
        "engine/cli",
        &[
            "analysis",
            "contract",
            "document",
            "execution",
            "imported",
            "presentation",
            "report",
            "session",
            "statistics",
            "study",
        ],
    ),
    (
        "engine",
        &[
            "analysis",
            "cli",
            "contract",
            "execution",
            "presentation",
            "session",
        ],
    ),
    // Tests alone stand on it.
    ("engine/testing", &["analysis", "contract"]),
    ("plugins/arithmetic", &[]),
    ("plugins/plan", &["arithmetic"]),
    ("plugins/bucket", &["contract", "execution"]),
    ("plugins/card", &["contract", "execution", "plan"]),
    ("plugins/numerics", &["arithmetic", "plan"]),
    ("plugins/protocols", &["contract", "document", "statistics"]),
    ("plugins/environments", &["arithmetic", "contract", "document"]),
    ("plugins/agents", &["contract", "numerics", "plan"]),
    (
        "plugins/estimators",
        &["arithmetic", "contract", "environments", "numerics"],
    ),
    (
        "plugins/generators",
        &["arithmetic", "contract", "numerics", "plan", "statistics"],
    ),
    (
        "plugins/programs",
        &["contract", "document", "execution", "imported", "numerics"],
    ),
    ("plugins/python", &["contract", "document", "execution"]),
    (
        ".",
        &[
            "agents",
            "bucket",
            "card",
            "cli",
            "contract",
            "environments",
            "estimators",
            "execution",
            "generators",
            "numerics",
            "programs",
            "protocols",
            "python",
        ],
    ),
    // Nothing stands on the Python package, which knows them all.
    (
        "plugins/wheel",
        &["contract", "document", "regimen", "session", "study"],
    ),
];

/// The crates of this project among the dependencies of a crate, but for those of its tests.
fn stands_on(folder: &str) -> Vec<String> {
    let manifest = std::fs::read_to_string(repository().join(folder).join("Cargo.toml")).unwrap();
    let section = manifest.split("\n[dependencies]\n").nth(1).unwrap_or_default();
    let section = section.split("\n[").next().unwrap_or_default();
    let name = |line: &str| line.split(['.', ' ', '=']).next().map(str::to_owned);
    let is_ours = |name: &String| {
        let folders = ARROWS.iter().map(|(folder, _)| folder.rsplit('/').next());
        folders.flatten().any(|it| it == name) || name == "regimen"
    };
    let mut found: Vec<String> = section.lines().filter_map(name).filter(is_ours).collect();
    found.sort_unstable();
    found
}

#[test]
fn crates_stand_on_those_that_are_listed() {
    let mut above = vec!["regimen"];
    for (folder, crates) in ARROWS {
        assert_eq!(stands_on(folder), crates, "{folder}/Cargo.toml");
        assert!(crates.iter().all(|name| above.contains(name)), "{folder}");
        above.extend(folder.rsplit('/').next());
    }
}

#[test]
fn the_page_on_the_architecture_has_a_row_for_every_crate() {
    let page = std::fs::read_to_string(repository().join("ARCHITECTURE.md")).unwrap();
    for (folder, _) in ARROWS.iter().filter(|(folder, _)| *folder != ".") {
        assert!(page.contains(&format!("| `{folder}/` |")), "{folder}");
    }
}

#[test]
fn one_folder_names_the_library_for_parquet() {
    visit(&repository().join("engine"), &mut |path, text| {
        let names_it = text.contains("use parquet::") || text.contains("use ::parquet::");
        assert!(
            !names_it || path.parent().unwrap().ends_with("engine/contract/src/parquet"),
            "{path:?}"
        );
    });
}

/// Code that two agents need lies in `shared`; one agent alone is about another, whose gradients it takes apart.
#[test]
fn no_agent_is_made_of_another() {
    let mut found = Vec::new();
    visit(&repository().join("plugins/agents/src"), &mut |path, text| {
        let foreign =
            |line: &&str| line.starts_with("use crate::") && !line.starts_with("use crate::shared::");
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        found.extend(
            text.lines()
                .filter(foreign)
                .map(|line| (name.clone(), line.to_owned())),
        );
    });
    let about = "use crate::tdom_ac::{self, OpponentObjective};";
    assert_eq!(found, [("opponent_gradients.rs".to_owned(), about.to_owned())]);
}

/// So that tests can put a simulated machine in its place.
#[test]
fn one_module_names_files_clocks_and_processes() {
    let mut found = Vec::new();
    for name in ["execution", "imported", "study", "report", "session", "cli"] {
        visit(
            &repository().join("engine").join(name).join("src"),
            &mut |path, text| {
                found.extend(foreign_words(path, text));
            },
        );
    }
    // The bar that shows progress has a clock of its own.
    found.retain(|it| !it.ends_with("commands/progress.rs: .elapsed()"));
    assert_eq!(found, [""; 0]);
}

/// Words of a file of code that touch files, clocks or processes past `execution::world`.
fn foreign_words(path: &Path, text: &str) -> Vec<String> {
    let name = path.to_string_lossy().into_owned();
    let is_test = name.ends_with("tests.rs") || name.contains("/tests/");
    if is_test || name.contains("/world/") {
        return Vec::new();
    }
    let text = text.split("#[cfg(test)]\nmod ").next().unwrap_or_default();
    let imported = text
        .split("use std::{")
        .nth(1)
        .and_then(|rest| rest.split("};").next());
    let imports = imported.unwrap_or_default().split([',', '{', '}', ' ', '\n']);
    let foreign = ["fs", "fs::File", "process::Command"];
    let imports = imports.filter(|it| foreign.contains(it) || it.starts_with("fs::"));
    let words = [
        "std::fs",
        "process::Command::",
        "std::process::id",
        "Instant::now()",
        "SystemTime::now()",
        "thread::sleep",
        "RandomState",
        ".elapsed()",
        ".exists()",
        ".canonicalize()",
        ".symlink_metadata()",
        "path.is_file()",
        "path.is_dir()",
        "folder.is_dir()",
    ];
    let words = words.into_iter().filter(|word| text.contains(word));
    imports.chain(words).map(|it| format!("{name}: {it}")).collect()
}

/// Folders whose code computes numbers of trials, and files of `numerics` that do.
const OF_TRIALS: [&str; 3] = [
    "plugins/environments/src",
    "plugins/estimators/src",
    "plugins/protocols/src",
];
const OF_NUMERICS: [&str; 11] = [
    "dirichlet.rs",
    "gamma.rs",
    "gauss_hermite.rs",
    "gaussian.rs",
    "matrices.rs",
    "onnx/operators.rs",
    "onnx/sums.rs",
    "onnx/tensor.rs",
    "policy_file.rs",
    "special.rs",
    "unscented.rs",
];

/// Methods of numbers that call the C library or leave an order of operations open, and replacements of them.
const REPLACED: [(&str, &str); 29] = [
    ("exp", "arithmetic::double::exp(x)"),
    ("exp_m1", "arithmetic::double::exp_m1(x)"),
    ("exp2", "arithmetic::power::pow(2.0, x)"),
    ("ln", "arithmetic::double::ln(x)"),
    ("ln_1p", "arithmetic::double::ln_1p(x)"),
    ("log", "arithmetic::double::ln(x) / arithmetic::double::ln(base)"),
    (
        "log2",
        "arithmetic::double::ln(x) * LOG2_E, which rounds otherwise",
    ),
    (
        "log10",
        "arithmetic::double::ln(x) * LOG10_E, which rounds otherwise",
    ),
    ("powf", "arithmetic::power::pow(x, y)"),
    ("powi", "a product, or arithmetic::power::powi(x, n)"),
    ("cbrt", "arithmetic::power::pow(x, 1.0 / 3.0)"),
    ("hypot", "(x * x + y * y).sqrt()"),
    ("tanh", "arithmetic::double::tanh(x)"),
    ("sin", "arithmetic::trigonometry::sin(x)"),
    ("cos", "arithmetic::trigonometry::cos(x)"),
    ("sin_cos", "sin and cos of arithmetic::trigonometry"),
    ("tan", "sin(x) / cos(x) of arithmetic::trigonometry"),
    ("sinh", "exp_m1 of arithmetic::double"),
    ("cosh", "exp of arithmetic::double"),
    ("asin", "a function that is new in arithmetic"),
    ("acos", "a function that is new in arithmetic"),
    ("atan", "a function that is new in arithmetic"),
    ("atan2", "a function that is new in arithmetic"),
    ("asinh", "ln and ln_1p of arithmetic::double"),
    ("acosh", "ln of arithmetic::double"),
    ("atanh", "ln_1p of arithmetic::double"),
    ("gamma", "arithmetic::gamma"),
    ("ln_gamma", "arithmetic::gamma::ln_gamma(x)"),
    ("mul_add", "x * y + z, or a chain of arithmetic::products"),
];

/// So that a trial's numbers have the same bits on every processor and with every C library.
#[test]
fn numbers_of_trials_are_computed_by_our_own_functions() {
    let mut found = Vec::new();
    for folder in OF_TRIALS {
        visit(&repository().join(folder), &mut |path, text| {
            found.extend(calls_of_the_c_library(path, text));
        });
    }
    let numerics = repository().join("plugins/numerics/src");
    for path in OF_NUMERICS.map(|name| numerics.join(name)) {
        let text = std::fs::read_to_string(&path).unwrap();
        found.extend(calls_of_the_c_library(&path, &text));
    }
    assert_eq!(found, [""; 0]);
    let line = "let x = y.exp().ln_1p() + z.map(f64::sqrt).map(f64::tanh); // w.sin()";
    assert_eq!(calls_of_the_c_library(Path::new("it.rs"), line).len(), 3);
}

/// Calls of methods of [`REPLACED`] in a file, outside comments and tests, with their lines and replacements.
fn calls_of_the_c_library(path: &Path, text: &str) -> Vec<String> {
    let is_test = path.iter().any(|part| {
        let part = part.to_string_lossy();
        part == "tests" || part.ends_with("tests.rs")
    });
    if is_test {
        return Vec::new();
    }
    let lines: Vec<&str> = text.lines().collect();
    let end = lines.windows(2).position(begins_tests).unwrap_or(lines.len());
    let mut found = Vec::new();
    for (number, line) in (1..).zip(&lines[..end]) {
        let line = line.split("//").next().unwrap_or_default();
        for (method, replacement) in REPLACED.iter().filter(|(method, _)| calls(line, method)) {
            let place = format!("{}:{number}", path.display());
            found.push(format!("{place}: `{method}` in place of {replacement}"));
        }
    }
    found
}

/// Whether a line calls a method of a number, or names it as `f64::method`.
fn calls(line: &str, method: &str) -> bool {
    let is_named = |kind: &str| {
        let name = format!("{kind}::{method}");
        let mut places = line.match_indices(&name);
        places.any(|(place, _)| line[place + name.len()..].chars().next().is_none_or(is_no_letter))
    };
    line.contains(&format!(".{method}(")) || is_named("f64") || is_named("f32")
}

/// A module can be read without those above it, and moved: none imports one that imports it.
#[test]
fn no_modules_at_the_top_of_a_crate_import_each_other_in_a_circle() {
    for (folder, _) in ARROWS.iter().filter(|(folder, _)| folder.starts_with("engine/")) {
        let arrows = arrows_of_modules(&repository().join(folder).join("src"));
        let mut reached = arrows.clone();
        for through in arrows.keys() {
            for from in arrows.keys() {
                if reached[from].contains(through) {
                    let more = reached[through].clone();
                    reached.get_mut(from).unwrap().extend(more);
                }
            }
        }
        let circle: Vec<&String> = arrows.keys().filter(|it| reached[*it].contains(*it)).collect();
        assert_eq!(
            circle, [""; 0],
            "modules of {folder} that import each other: {arrows:#?}"
        );
    }
}

/// The modules at the top of a crate, each with those that its code names. What the root of the crate defines belongs
/// to none of them; what it takes out of a module belongs to that one.
fn arrows_of_modules(source: &Path) -> BTreeMap<String, BTreeSet<String>> {
    let mut files = Vec::new();
    visit(source, &mut |path, text| {
        let path = path.strip_prefix(source).unwrap().with_extension("");
        let mut module: Vec<String> = path.iter().map(|it| it.to_string_lossy().into_owned()).collect();
        if module.last().is_some_and(|it| it == "mod") {
            module.pop();
        }
        let is_test = module.iter().any(|it| it == "tests" || it.ends_with("_tests"));
        if !is_test {
            files.push((module, code(text)));
        }
    });
    let modules: BTreeSet<String> = files.iter().map(|(module, _)| module[0].clone()).collect();
    let root = files.iter().find(|(module, _)| module[0] == "lib").unwrap();
    let mut owners: BTreeMap<&str, &str> = BTreeMap::new();
    for statement in root.1.split(';') {
        let path = statement
            .split_once("use ")
            .and_then(|(_, path)| path.split_once("::"));
        if let Some((module, names)) = path.filter(|(module, _)| modules.contains(*module)) {
            let names = names.split(is_no_letter).filter(|name| !name.is_empty());
            owners.extend(names.map(|name| (name, module)));
        }
    }
    owners.extend(modules.iter().map(|it| (it.as_str(), it.as_str())));
    let mut arrows: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for (module, text) in files.iter().filter(|(module, _)| module[0] != "lib") {
        let named = named_of_root(text, module.len());
        let named = named
            .iter()
            .filter_map(|name| owners.get(name))
            .map(|it| (*it).to_owned());
        let named = named.filter(|it| *it != module[0]);
        arrows.entry(module[0].clone()).or_default().extend(named);
    }
    arrows
}

/// A file without comments and without the tests at its end.
fn code(text: &str) -> String {
    let lines: Vec<&str> = text
        .lines()
        .filter(|line| !line.trim_start().starts_with("//"))
        .collect();
    let end = lines.windows(2).position(begins_tests);
    lines[..end.unwrap_or(lines.len())].join("\n")
}

fn begins_tests(pair: &[&str]) -> bool {
    pair[0] == "#[cfg(test)]" && pair[1].ends_with("mod tests {")
}

/// The names of the root of a crate that the code of a module names, which lies so many modules below the root.
fn named_of_root(text: &str, depth: usize) -> BTreeSet<&str> {
    let mut found = BTreeSet::new();
    for root in ["crate::", &"super::".repeat(depth)] {
        for (place, _) in text.match_indices(root) {
            let is_whole = !text[..place].ends_with(|it| it == ':' || !is_no_letter(it));
            let rest = &text[place + root.len()..];
            found.extend(is_whole.then(|| first_names(rest)).into_iter().flatten());
        }
    }
    found
}

/// The first name of a path, or of each path in a list in braces.
fn first_names(path: &str) -> Vec<&str> {
    fn first(path: &str) -> &str {
        path.trim_start().split(is_no_letter).next().unwrap_or_default()
    }
    let Some(list) = path.strip_prefix('{') else {
        return vec![first(path)];
    };
    let (mut names, mut depth) = (vec![first(list)], 0);
    for (place, letter) in list.char_indices() {
        match letter {
            '}' if depth == 0 => break,
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => names.push(first(&list[place + 1..])),
            _ => {}
        }
    }
    names
}

fn is_no_letter(it: char) -> bool {
    !it.is_alphanumeric() && it != '_'
}

fn visit(folder: &Path, seen: &mut dyn FnMut(&Path, &str)) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            visit(&path, seen);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            seen(&path, &std::fs::read_to_string(&path).unwrap());
        }
    }
}
