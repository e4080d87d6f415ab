//! The reference in `docs/`: generated pages are those that the program makes now, links lead somewhere, studies in it
//! pass `check`, and its reader of policies reads policies.
//!
//! The book is the pages of `docs/src` with the reference that the program writes.

use crate::{
    needs,
    program::{Bench, repository, trial_files},
};
use cli::describe::markdown;
use document::diagnostic::render;
use numerics::{
    activation::Activation,
    policy_file::{Head, Policy, Ports},
};
use plugins::registry;
use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
use session::Exit;
use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
    process::Command,
    sync::LazyLock,
};

/// The pages of `docs/src` beside the reference, which the program wrote.
fn source() -> &'static Path {
    static BOOK: LazyLock<tempfile::TempDir> = LazyLock::new(|| {
        let book = tempfile::tempdir().unwrap();
        let pages = fs::read_dir(repository().join("docs/src")).unwrap();
        let pages = pages.map(|it| it.unwrap().path()).filter(|it| it.is_file());
        for page in pages {
            fs::copy(&page, book.path().join(page.file_name().unwrap())).unwrap();
        }
        let reference = book.path().join("reference");
        Bench::new().ok(&["describe", "--pages", &reference.to_string_lossy()]);
        book
    });
    BOOK.path()
}

/// Every page by its path below `docs/src`.
fn pages() -> Vec<(PathBuf, String)> {
    fn visit(folder: &Path, found: &mut Vec<(PathBuf, String)>) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                visit(&path, found);
            } else if path.extension().is_some_and(|end| end == "md") {
                found.push((path.clone(), fs::read_to_string(&path).unwrap()));
            }
        }
    }
    let mut found = Vec::new();
    visit(source(), &mut found);
    found.sort();
    found
}

/// The lines of a page outside of its blocks of code.
fn prose(text: &str) -> impl Iterator<Item = &str> {
    let mut in_code = false;
    text.lines().filter(move |line| {
        let is_fence = line.starts_with("```");
        in_code ^= is_fence;
        !in_code && !is_fence
    })
}

/// The blocks of code of a page in a language.
pub(crate) fn blocks(text: &str, language: &str) -> Vec<String> {
    let parts = text
        .split("\n```")
        .enumerate()
        .filter(|(index, _)| index % 2 == 1);
    let of_language = parts.filter_map(|(_, part)| part.strip_prefix(&format!("{language}\n")));
    of_language.map(|part| format!("{part}\n")).collect()
}

#[test]
fn the_reference_has_a_page_for_every_group_and_no_other() {
    let reference = source().join("reference");
    let mut names = BTreeSet::new();
    for page in markdown::pages(&registry()) {
        let written = fs::read_to_string(reference.join(&page.file)).unwrap();
        assert_eq!(written, page.text, "{}", page.file);
        names.insert(page.file);
    }
    let there = fs::read_dir(&reference).unwrap();
    let there: BTreeSet<String> = there
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    assert_eq!(there, names);
    let refused = Bench::new().run(&["describe", "battery", "--pages", "x"]);
    assert_eq!(refused.code, 2, "{}", refused.err);
}

/// The anchor that mdBook gives a heading.
fn anchor(heading: &str) -> String {
    let text = heading
        .trim_start_matches('#')
        .trim()
        .replace("&gt;", ">")
        .replace("&lt;", "<");
    let kept = text.chars().filter_map(|letter| match letter {
        ' ' => Some('-'),
        '-' | '_' => Some(letter),
        letter if letter.is_alphanumeric() => Some(letter.to_ascii_lowercase()),
        _ => None,
    });
    kept.collect()
}

fn anchors(text: &str) -> BTreeSet<String> {
    prose(text)
        .filter(|line| line.starts_with('#'))
        .map(anchor)
        .collect()
}

/// Targets of the links in a line.
fn links(line: &str) -> Vec<&str> {
    let parts = line.split("](").skip(1);
    parts.filter_map(|part| part.split(')').next()).collect()
}

#[test]
fn every_link_of_the_book_leads_somewhere() {
    let mut counted = 0;
    for (path, text) in pages() {
        for link in prose(&text).flat_map(links) {
            let (file, place) = link.split_once('#').unwrap_or((link, ""));
            let beside = path.parent().unwrap().join(file);
            let target = match file.is_empty() {
                true => path.clone(),
                // A link may lead out of the book, to a page of the repository.
                false if file.starts_with("../../") => repository().join("docs/src").join(file),
                false => beside,
            };
            let there = fs::read_to_string(&target);
            let there = there.unwrap_or_else(|error| panic!("{}: {link}: {error}", path.display()));
            assert!(
                place.is_empty() || anchors(&there).contains(place),
                "{}: {link} has no such heading",
                path.display()
            );
            counted += 1;
        }
    }
    assert!(counted > 200, "{counted} links");
}

/// The paths of source files without their `src` folders.
fn sources() -> Vec<String> {
    fn visit(folder: &Path, found: &mut Vec<String>) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                visit(&path, found);
            } else if path.extension().is_some_and(|end| end == "rs") {
                found.push(path.to_string_lossy().replace("/src/", "/"));
            }
        }
    }
    let mut found = Vec::new();
    ["engine", "plugins", "tests", "examples"]
        .iter()
        .for_each(|folder| visit(&repository().join(folder), &mut found));
    found
}

#[test]
fn every_source_file_that_the_book_names_is_there() {
    let sources = sources();
    for (page, text) in pages() {
        let words = text.split('`').skip(1).step_by(2);
        for named in words
            .filter(|word| word.ends_with(".rs") && word.contains('/') && !word.contains(['*', '<', ' ']))
        {
            let end = format!("/{}", named.replace("/src/", "/"));
            assert!(
                sources.iter().any(|path| path.ends_with(&end)),
                "{}: there is no file `{named}`",
                page.display()
            );
        }
    }
}

#[test]
fn every_page_is_in_the_summary_and_names_no_heading_twice() {
    let summary = fs::read_to_string(source().join("SUMMARY.md")).unwrap();
    for (path, text) in pages() {
        let name = path
            .strip_prefix(source())
            .unwrap()
            .to_string_lossy()
            .into_owned();
        assert!(
            name == "SUMMARY.md" || summary.contains(&format!("({name})")),
            "{name}"
        );
        // A relation of claims is a symbol, to which nothing links.
        let headings: Vec<String> = prose(&text)
            .filter(|line| line.starts_with('#'))
            .map(anchor)
            .filter(|anchor| !anchor.is_empty())
            .collect();
        let different: BTreeSet<&String> = headings.iter().collect();
        assert!(
            name == "SUMMARY.md" || headings.len() == different.len(),
            "{name}: {headings:?}"
        );
    }
}

#[test]
fn whole_studies_of_the_book_pass_check() {
    let registry = registry();
    let mut counted = 0;
    for (path, text) in pages()
        .iter()
        .filter(|(path, _)| !path.ends_with("reference/sections.md"))
        // Their studies need files beside them, and a Python with packages, and are run where these are.
        .filter(|(path, _)| {
            let with_files = ["programs.md", "python-environments.md", "python-agents.md"];
            !with_files.iter().any(|page| path.ends_with(page))
        })
        .filter(|(path, _)| !path.to_string_lossy().contains("coming-from-"))
    {
        for study in blocks(text, "yaml")
            .iter()
            .filter(|block| block.contains("\nprotocol:"))
        {
            for profile in [None, Some("smoke".to_owned())] {
                let options = study::Options {
                    profile,
                    ..study::Options::default()
                };
                let checked = study::load_text(study, "study.yaml", Path::new(""), &registry, &options);
                if let Err(found) = checked {
                    panic!("{}\n{}", path.display(), render(&found, false));
                }
                counted += 1;
            }
        }
    }
    assert!(counted > 0);
}

#[test]
fn the_exit_codes_and_the_version_of_the_book_are_the_programs() {
    let commands = fs::read_to_string(source().join("commands.md")).unwrap();
    for exit in Exit::ALL {
        assert!(commands.contains(&format!("\n| {} |", exit.code())), "{exit:?}");
    }
    let describe = fs::read_to_string(source().join("describe.md")).unwrap();
    assert!(describe.contains(&format!("\"format\": {}", cli::describe::FORMAT)));
    let help = Bench::new().ok(&["--help"]);
    let verbs = help.lines().skip_while(|line| *line != "Commands:").skip(1);
    let verbs = verbs.filter(|line| !line.starts_with("   "));
    for verb in verbs
        .take_while(|line| !line.is_empty())
        .filter_map(|line| line.split_whitespace().next())
    {
        let is_told = commands.contains(&format!("`regimen {verb}")) || verb == "help";
        assert!(is_told, "{verb}");
    }
}

/// The lines of the book that read a policy, and a program around them.
fn reader(bench: &Bench) -> PathBuf {
    let page = fs::read_to_string(source().join("policy-file.md")).unwrap();
    let reader = blocks(&page, "python").concat();
    let main = "
for path in sys.argv[1:]:
    header, tensors = read(path)
    rows = [[center + 0.3 * k * spread for center, spread in zip(header[\"center\"], header[\"spread\"])] for k in range(4)]
    print(json.dumps([[row, [float(x) for x in act(header, tensors, row)]] for row in rows]))
";
    bench.write("reader.py", &format!("{reader}{main}"))
}

/// Policies by the reader of the book: observations with actions, policy by policy; `None`, after a
/// line, where there is no Python with NumPy.
fn read_by_the_book(bench: &Bench, files: &[PathBuf]) -> Option<Vec<Vec<[Vec<f64>; 2]>>> {
    let output = Command::new(needs::python("numpy")?)
        .arg(reader(bench))
        .args(files)
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let text = String::from_utf8(output.stdout).unwrap();
    Some(
        text.lines()
            .map(|line| serde_json::from_str(line).unwrap())
            .collect(),
    )
}

fn agrees(policy: &Policy, rows: &[[Vec<f64>; 2]]) {
    assert_eq!(rows.len(), 4);
    for [observation, theirs] in rows {
        let ours = policy.act(observation);
        assert_eq!(ours.len(), theirs.len());
        let off = ours
            .iter()
            .zip(theirs)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        assert!(off < 1e-5, "{:?}: {ours:?} {theirs:?}", policy.header.head);
    }
}

#[test]
fn the_reader_of_the_book_reads_every_head() {
    let bench = Bench::new();
    let heads = [
        Head::DirichletMean,
        Head::DirichletMode,
        Head::SoftmaxMean,
        Head::Tanh,
        Head::Argmax,
        Head::Identity,
    ];
    let words = |stem: &str| (0..3).map(|index| format!("{stem}_{index}")).collect::<Vec<_>>();
    let files: Vec<PathBuf> = heads
        .iter()
        .enumerate()
        .map(|(index, head)| {
            let mut rng = ChaCha8Rng::seed_from_u64(index as u64);
            let activations = [Activation::Tanh, Activation::LeakyRelu, Activation::Relu];
            let ports = Ports {
                inputs: words("seen"),
                center: vec![1.0, -2.0, 0.5],
                spread: vec![0.5, 3.0, 1.0],
                outputs: words("done"),
            };
            let mut policy = Policy::untrained(&[3, 8, 8, 8, 6], &activations, ports, *head, &mut rng);
            if *head == Head::Identity {
                policy = policy.in_units(vec![700.0, 0.0, 1.0], vec![5.0, 2.0, 1.0]);
            }
            let folder = bench.path(&format!("head-{index}"));
            fs::create_dir(&folder).unwrap();
            policy.write(&folder).unwrap();
            folder.join("policy.safetensors")
        })
        .collect();
    let Some(read) = read_by_the_book(&bench, &files) else {
        return;
    };
    for (file, rows) in files.iter().zip(read) {
        agrees(&Policy::read(file.parent().unwrap()).unwrap(), &rows);
    }
    let page = fs::read_to_string(source().join("policy-file.md")).unwrap();
    for head in heads {
        let word = serde_json::to_value(head).unwrap();
        assert!(
            page.contains(&format!("\n| `{}` |", word.as_str().unwrap())),
            "{word}"
        );
    }
}

const STUDY: &str = "
study: policies
environments: { cells: { battery: { cells: 3 } } }
agents:
  dsac: { dirichlet_sac: { width: 16, batch_size: 16, learning_starts: 64 } }
  sac: { gaussian_softmax_sac: { width: 16, batch_size: 16, learning_starts: 64 } }
protocol: { train_evaluate: { steps: 128, environments: 8, evaluate_every: 0, final_episodes: 1 } }
";

#[test]
fn the_reader_of_the_book_reads_what_a_study_leaves() {
    let bench = Bench::new();
    bench.write("policies.yaml", STUDY);
    bench.ok(&["run", "policies.yaml"]);
    let files: Vec<PathBuf> = trial_files(&bench.path("store"))
        .iter()
        .map(|file| file.with_file_name("policy.safetensors"))
        .collect();
    assert_eq!(files.len(), 2);
    let Some(read) = read_by_the_book(&bench, &files) else {
        return;
    };
    for (file, rows) in files.iter().zip(read) {
        agrees(&Policy::read(file.parent().unwrap()).unwrap(), &rows);
        assert!(
            rows.iter()
                .all(|[_, shares]| (shares.iter().sum::<f64>() - 1.0).abs() < 1e-9)
        );
    }
}
