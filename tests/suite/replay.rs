//! `replay`: what is recorded can be seen, in a browser that is driven too.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

use crate::common::{data, fail, succeed};

/// A folder with traces of the same three episodes: one imputer, another, and delays.
struct Traces(tempfile::TempDir);

impl Traces {
    fn new() -> Traces {
        let traces = Traces(tempfile::tempdir().unwrap());
        for (name, words) in [
            ("one.json", "--p 0.3"),
            ("other.json", "--p 0.3 --imputer hold"),
            ("delays.json", "--links delay(2,2)"),
        ] {
            let path = traces.at(name);
            succeed(&format!("spawn --task hear-see --episodes 3 --in-process {words} --record {path}"));
        }
        traces
    }

    fn at(&self, name: &str) -> String {
        self.0.path().join(name).display().to_string()
    }

    fn read(&self, name: &str) -> String {
        std::fs::read_to_string(self.at(name)).unwrap()
    }

    fn json(&self, name: &str) -> Value {
        serde_json::from_str(&self.read(name)).unwrap()
    }
}

/// What a page embeds.
fn embedded(page: &str) -> Value {
    let data = page.split("<script id=\"data\" type=\"application/json\">").nth(1).unwrap();
    serde_json::from_str(data.split("</script>").next().unwrap()).unwrap()
}

#[test]
fn a_page_holds_what_it_plays_and_nothing_from_elsewhere() {
    let traces = Traces::new();
    let (one, other, page) = (traces.at("one.json"), traces.at("other.json"), traces.at("page.html"));
    let said = succeed(&format!("replay {one} {other} --html {page}"));
    assert!(said.contains("hear-see, 3 episodes"), "{said}");
    let page = traces.read("page.html");
    for elsewhere in ["http:", "https:", "src=", "href=", "@import", "fetch("] {
        assert!(!page.contains(elsewhere), "{elsewhere}");
    }
    let films = embedded(&page)["films"].as_array().unwrap().clone();
    assert_eq!([&films[0]["name"], &films[1]["name"]], ["one", "other"]);
    for film in &films {
        let episodes = film["episodes"].as_array().unwrap();
        assert_eq!(episodes.len(), 3);
        assert!(episodes.iter().all(|episode| episode["ghosts"].is_string() && episode["steps"] == 25));
    }
    succeed(&format!("replay {one} --html {} --episode 2", traces.at("single.html")));
    assert_eq!(embedded(&traces.read("single.html"))["films"][0]["episodes"].as_array().unwrap().len(), 1);
    // The worlds of other programs have no agents' side.
    let recording = data("recordings/spread-xy-2.json");
    succeed(&format!("replay {} --html {}", recording.display(), traces.at("world.html")));
    let film = &embedded(&traces.read("world.html"))["films"][0];
    assert!(film["episodes"][0]["links"].is_null() && film["viewer"] == -1, "{film}");
}

#[test]
fn what_cannot_be_seen_is_said() {
    let traces = Traces::new();
    let (one, page) = (traces.at("one.json"), traces.at("page.html"));
    let recording = data("recordings/spread-xy-2.json");
    fail(&format!("replay {one}"), 2, &["--html"]);
    fail(&format!("replay {one} --html {page} --episode 9"), 2, &["has no episode 9"]);
    fail(&format!("replay {one} {} --html {page}", recording.display()), 2, &["of one task"]);
    fail(&format!("replay {} --html {page}", traces.at("nothing")), 2, &["there is no file"]);
    std::fs::write(traces.at("half.json"), &traces.read("one.json")[..9000]).unwrap();
    fail(&format!("replay {} --html {page}", traces.at("half.json")), 1, &["half.json"]);
    let mut nonsense = traces.json("one.json");
    nonsense["episodes"][1]["joint_estimate"][3][0] = Value::from(vec![0.5]);
    std::fs::write(traces.at("nonsense.json"), nonsense.to_string()).unwrap();
    fail(&format!("replay {} --html {page}", traces.at("nonsense.json")), 2, &["another length"]);
    assert!(!Path::new(&page).exists());
    // What is far away is drawn, and what is nowhere is refused.
    let mut far = traces.json("one.json");
    far["episodes"][0]["agent_pos"][5][0][0] = Value::from(9e8);
    std::fs::write(traces.at("far.json"), far.to_string()).unwrap();
    succeed(&format!("replay {} --svg {}", traces.at("far.json"), traces.at("far.svg")));
    assert!(traces.read("far.svg").matches("<polyline").count() < 200);
    far["episodes"][0]["agent_pos"][5][0][0] = Value::from(1e300);
    std::fs::write(traces.at("far.json"), far.to_string()).unwrap();
    fail(&format!("replay {} --html {page}", traces.at("far.json")), 2, &["up to 1e9 m"]);
}

/// A browser that can be driven, if there is one.
fn browser() -> Option<PathBuf> {
    let folders = std::env::split_paths(&std::env::var_os("PATH")?).collect::<Vec<_>>();
    let names = ["chromium", "chromium-browser", "google-chrome"];
    folders.iter().flat_map(|folder| names.map(|name| folder.join(name))).find(|path| path.exists())
}

/// What stands before and behind a script, which defines `act`: what it checks, and a list of that in the page.
const BEFORE: &str = r#"
const found = [];
const check = (what, holds) => found.push(`${holds ? "ok" : "FAIL"} ${what}`);
"#;
const BEHIND: &str = r#"
act().catch((error) => check(error, false)).then(() => {
  const list = document.createElement("pre");
  list.id = "found";
  list.textContent = found.join("\n");
  document.body.append(list);
});
"#;

/// Loads a page without a window, has a script act on it, and returns what that checked: a line each.
fn drive(browser: &Path, page: &str, script: &str, folder: &Path) -> String {
    let driven = folder.join("driven.html");
    let script = [BEFORE, script, BEHIND].concat();
    std::fs::write(&driven, page.replace("</body>", &format!("<script>{script}</script></body>"))).unwrap();
    let quiet = "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-sync \
                 --disable-background-networking --disable-component-update --virtual-time-budget=5000 --dump-dom";
    let output = Command::new(browser)
        .args(quiet.split_whitespace())
        .arg(format!("--user-data-dir={}", folder.join("browser").display()))
        .arg(format!("file://{}", driven.display()))
        .output()
        .unwrap();
    let after = String::from_utf8_lossy(&output.stdout);
    let found = after.split("<pre id=\"found\">").nth(1).unwrap_or_else(|| panic!("nothing found: {after}"));
    found.split("</pre>").next().unwrap().to_owned()
}

/// Acts as a reader would.
const READER: &str = r#"
const caption = (index) => byId(`told-${index}`).textContent;
const picture = () => byId("stage-0").toDataURL() + byId("stage-1").toDataURL();
const press = (key) => document.body.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true }));
const pause = (ms) => new Promise((done) => setTimeout(done, ms));
async function act() {
  check("begins at the beginning", caption(0).startsWith("step 0 of 25, return 0.0"));
  byId("step").value = 12;
  byId("step").dispatchEvent(new Event("input"));
  check("scrubs", caption(0).startsWith("step 12 of 25") && caption(1).startsWith("step 12 of 25"));
  check("says so", byId("step").getAttribute("aria-valuetext") === "step 12 of 25");
  for (const what of ["links", "trails", "ghosts"]) {
    const before = picture();
    byId(what).click();
    check(`hides ${what}`, picture() !== before);
    byId(what).click();
    check(`shows ${what}`, picture() === before);
  }
  const before = picture();
  press("a");
  check("another agent sees another thing", picture() !== before && caption(0).includes("agent 1 hears"));
  press("ArrowRight");
  check("goes a step on", caption(0).startsWith("step 13"));
  press("End");
  check("has the return", caption(0).includes(`return ${EXPECTED[0]}`) && caption(1).includes(`return ${EXPECTED[1]}`));
  press("Home");
  byId("play").click();
  check("plays", byId("play").textContent === "Pause");
  // A busy machine draws frames when it can.
  for (let waits = 0; now.time === 0 && waits < 20; waits++) await pause(100);
  if (now.playing) press(" ");
  const stopped = now.time;
  check("played", stopped > 0 && byId("play").textContent === "Play");
  await pause(200);
  check("pauses", now.time === stopped && byId("said").textContent.includes("one: step"));
  press("n");
  check("shows the next episode", byId("episode").selectedIndex === 1 && now.time === 0);
  const box = byId("curves").getBoundingClientRect();
  byId("curves").dispatchEvent(new PointerEvent("pointerdown", { buttons: 1, clientX: box.right - 12 }));
  check("the curves are a scrubber", now.time === 25);
  for (const part of document.querySelectorAll("button, select, input, canvas")) {
    const name = part.getAttribute("aria-label") || part.labels?.[0]?.textContent || part.textContent;
    check(`${part.id} has a name`, name.trim() !== "");
  }
  check("fits a phone", document.documentElement.scrollWidth <= innerWidth);
}
"#;

#[test]
fn a_browser_plays_the_page() {
    let Some(browser) = browser() else {
        eprintln!("skipped: there is no chromium to look at the page with");
        return;
    };
    let traces = Traces::new();
    let (one, other) = (traces.at("one.json"), traces.at("other.json"));
    succeed(&format!("replay {one} {other} --html {}", traces.at("page.html")));
    let expected = ["one.json", "other.json"].map(|name| {
        let total = traces.json(name)["episodes"][0]["return"].as_f64().unwrap();
        format!("{total:.1}")
    });
    let script = format!("const EXPECTED = {expected:?};{READER}");
    let found = drive(&browser, &traces.read("page.html"), &script, traces.0.path());
    assert!(found.lines().count() > 25 && !found.contains("FAIL"), "{found}");
}

/// What an evaluation of eight episodes wrote, and where.
fn evaluated(folder: &Path, imputers: &str) -> String {
    succeed(&format!(
        "evaluate builtin --task hear-see --episodes 8 --levels 1,0.4,0 --imputers {imputers} --in-process --report {}",
        folder.display()
    ));
    std::fs::read_to_string(folder.join("report.html")).unwrap()
}

/// The return that `episodes.csv` has of an episode.
fn listed(folder: &Path, imputer: &str, p: &str, episode: usize) -> f64 {
    let rows = std::fs::read_to_string(folder.join("episodes.csv")).unwrap();
    let wanted = format!("hear-see,builtin,{imputer},level,{p},{episode},");
    let row = rows.lines().find_map(|row| row.strip_prefix(&wanted[..]).map(str::to_owned));
    row.unwrap_or_else(|| panic!("no {wanted} in {rows}")).parse().unwrap()
}

#[test]
fn a_report_leads_to_the_best_and_worst_episodes() {
    let folder = tempfile::tempdir().unwrap();
    let report = evaluated(folder.path(), "hold,dynamics");
    let links: Vec<&str> = report
        .match_indices("href=\"replays/")
        .map(|(at, _)| report[at + 6..].split('"').next().unwrap())
        .collect();
    let expected = ["hold-best", "hold-worst", "dynamics-best", "dynamics-worst"];
    assert_eq!(links, expected.map(|name| format!("replays/1-hear-see-{name}.html")));
    for link in links {
        let page = std::fs::read_to_string(folder.path().join(link)).unwrap();
        assert!(page.len() < 60_000, "{} bytes", page.len());
        let imputer = if link.contains("hold") { "hold" } else { "dynamics" };
        let all: Vec<f64> = (0..8).map(|episode| listed(folder.path(), imputer, "0", episode)).collect();
        let extreme = if link.contains("best") { f64::max } else { f64::min };
        let wanted = all.iter().copied().reduce(extreme).unwrap();
        let episode = all.iter().position(|value| *value == wanted).unwrap();
        assert!(report.contains(&format!("{wanted:.1} (episode {episode})")), "{wanted}, {episode}");
        let films = embedded(&page)["films"].as_array().unwrap().clone();
        // The return in the end, as the page has it: four bytes behind those of 25 steps before.
        let returns = films.iter().map(|film| last_f32(film["episodes"][0]["returns"].as_str().unwrap()));
        let everything = listed(folder.path(), imputer, "1", episode);
        assert_eq!(returns.collect::<Vec<_>>(), [wanted as f32, everything as f32], "{link}");
        assert!(page.contains(&format!("{imputer}, p = 0,")) && page.contains("p = 1"));
    }
    // What this report does not lead to goes.
    evaluated(folder.path(), "dynamics");
    assert_eq!(std::fs::read_dir(folder.path().join("replays")).unwrap().count(), 2);
}

/// The last of the numbers in a text of 26 of them: 104 bytes, so that the last group of three holds but two.
fn last_f32(base64: &str) -> f32 {
    let letters = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let six = |letter: char| letters.find(letter).map(|six| six as u32);
    let bytes: Vec<u8> = base64
        .as_bytes()
        .chunks(4)
        .flat_map(|group| {
            let bits =
                group.iter().fold(0, |bits, letter| bits << 6 | six(char::from(*letter)).unwrap_or_default());
            bits.to_be_bytes()[1..].to_vec()
        })
        .collect();
    f32::from_le_bytes(bytes[100..104].try_into().unwrap())
}

/// Plays what a report leads to, to its end.
const GUEST: &str = r#"
async function act() {
  check("says what it is", byId("told-0").textContent.startsWith("step 0 of 25"));
  byId("play").click();
  check("plays", now.playing && byId("play").textContent === "Pause");
  document.body.dispatchEvent(new KeyboardEvent("keydown", { key: "End", bubbles: true }));
  check("ends", now.time === 25 && !now.playing);
  check("side by side", [0, 1].every((index) => byId(`told-${index}`).textContent.startsWith("step 25 of 25")));
}
"#;

#[test]
fn a_browser_plays_what_a_report_leads_to() {
    let Some(browser) = browser() else {
        eprintln!("skipped: there is no chromium to look at the page with");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let report = evaluated(folder.path(), "hold");
    let link = report.split("href=\"replays/").nth(2).unwrap().split('"').next().unwrap();
    let page = std::fs::read_to_string(folder.path().join("replays").join(link)).unwrap();
    let found = drive(&browser, &page, GUEST, folder.path());
    assert!(found.lines().count() == 4 && !found.contains("FAIL"), "{found}");
}

/// The pixels of the first frame and of the last, the number of frames, and how long each is shown, from an animated GIF.
fn frames(path: &str) -> (Vec<u8>, Vec<u8>, usize, u16) {
    let mut options = gif::DecodeOptions::new();
    options.set_color_output(gif::ColorOutput::Indexed);
    let mut decoder = options.read_info(std::fs::File::open(path).unwrap()).unwrap();
    let width = usize::from(decoder.width());
    let mut canvas = vec![0; width * usize::from(decoder.height())];
    let (mut first, mut number, mut delay) = (Vec::new(), 0, 0);
    while let Some(frame) = decoder.read_next_frame().unwrap() {
        let (left, top, wide) = (usize::from(frame.left), usize::from(frame.top), usize::from(frame.width));
        for (at, pixel) in
            frame.buffer.iter().enumerate().filter(|(_, pixel)| Some(**pixel) != frame.transparent)
        {
            canvas[(top + at / wide) * width + left + at % wide] = *pixel;
        }
        if number == 0 {
            (first, delay) = (canvas.clone(), frame.delay);
        }
        number += 1;
    }
    (first, canvas, number, delay)
}

#[test]
fn films_and_frames_are_drawn() {
    let traces = Traces::new();
    let (one, other, film) = (traces.at("one.json"), traces.at("other.json"), traces.at("film.gif"));
    succeed(&format!("replay {one} --gif {film} --episode 1"));
    let (first, last, number, delay) = frames(&film);
    assert_eq!((number, delay), (101, 5), "25 steps of 0.1 s, half as fast");
    assert!(first.len() == last.len() && first != last);
    let bytes = std::fs::metadata(&film).unwrap().len();
    assert!((10_000..400_000).contains(&bytes), "{bytes} bytes");
    let frame = traces.at("frame.svg");
    succeed(&format!("replay {one} {other} --svg {frame} --step 12 --agent 1"));
    let picture = traces.read("frame.svg");
    let told = |name: &str| {
        let rewards = traces.json(name)["episodes"][0]["team_reward"].as_array().unwrap()[..12].to_vec();
        let sum: f64 = rewards.iter().map(|reward| reward.as_f64().unwrap()).sum();
        format!("step 12 of 25, return {sum:.1}")
    };
    for name in ["one.json", "other.json"] {
        assert!(picture.contains(&told(name)), "{name}: {picture}");
    }
    assert!(picture.contains("dynamics, p = 0.3") && picture.contains("hold, p = 0.3"), "{picture}");
    fail(&format!("replay {one} --svg {frame} --step 26"), 2, &["no step 26"]);
    fail(&format!("replay {one} --svg {frame} --agent 2"), 2, &["no agent 2"]);
    fail(&format!("replay {one} --gif {film} --step 2"), 2, &["--svg"]);
}

#[test]
fn delays_are_in_the_page() {
    let traces = Traces::new();
    succeed(&format!("replay {} --html {}", traces.at("delays.json"), traces.at("page.html")));
    let film = &embedded(&traces.read("page.html"))["films"][0];
    assert!(film["episodes"][0]["links"].as_str().unwrap().contains('I'), "an age of two");
}
