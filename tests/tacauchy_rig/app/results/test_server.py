"""A folder of runs is found; its pages show it, let in whom they may, and write nothing."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from tacauchy_rig.app.results.results_pages import ListedRun, differing, find_runs, folder_of_runs
from tacauchy_rig.core.errors import ConfigError
from tests.recorded_run import empty_run
from tests.tacauchy_rig.app.results.made_runs import NAMES, TOKEN, Client, served
from tests.tacauchy_rig.core.store.test_trusted_force import keep, weigh
from tests.tacauchy_rig.core.test_force_sensor_gain import RIGHT, pressed

FIRST, SECOND, ABORTED, DAMAGED = NAMES
PAGES = ("", "compare", f"compare?a={FIRST}&b={SECOND}", f"health/{FIRST}", "results.css")


def test_every_run_is_listed_and_says_what_it_came_to(client: Client) -> None:
    """A damaged one by name with what is wrong; one that broke off with what to do next."""
    page = client.get("").text
    assert page.index(DAMAGED) > 0
    assert "cannot be read" in page
    assert "&lt;b&gt;six" in page
    assert "<b>six" not in page
    assert f"tacauchy-rig resume {client_root(page)}{ABORTED}" in page
    assert f"/run/{FIRST}/report/report.html" in page
    assert "notes" not in page


def client_root(page: str) -> str:
    """Return the folder that a page says its runs lie in."""
    return page.split("4 in ")[1].split(". This page", maxsplit=1)[0] + "/"


def test_two_runs_are_compared_against_their_deviations(client: Client) -> None:
    """The modulus grew by a tenth of what is stated, which is 3.5 of both deviations."""
    page = client.get(f"compare?a={FIRST}&b={SECOND}").text
    assert "modulus, of the stated one" in page
    assert "+3.5" in page
    assert "replace the gel" in page


@pytest.mark.parametrize("asked", ["", f"?a={SECOND}", f"?b={FIRST}", f"?a={FIRST}"])
def test_a_comparison_starts_with_two_different_runs(client: Client, asked: str) -> None:
    """What is not asked for is another run than what is."""
    page = client.get(f"compare{asked}").text
    chosen = re.findall(r'value="([^"]+)" selected', page)
    assert len(set(chosen)) == 2
    assert "What their reports say" in page
    assert "one run: choose two" in client.get(f"compare?a={FIRST}&b={FIRST}").text


def test_health_follows_a_sensor_with_the_limits_of_check_press(client: Client) -> None:
    """A chart for each thing that may change; the change that counts is marked."""
    page = client.get(f"health/{SECOND}").text
    assert page.count("<svg") == 6
    assert "8.0 %" in page
    assert 'class="bad"' in page
    assert f"{SECOND}: +20" in page


def test_files_of_a_report_are_served_where_their_scripts_reach_nothing(client: Client) -> None:
    """With a policy of their own: a sandbox without our origin."""
    found = client.of_run(FIRST, "report/report.html")
    assert found.status == 200
    policy = found.headers["content-security-policy"]
    assert "sandbox" in policy
    assert "allow-same-origin" not in policy
    assert "allow-popups" not in policy
    assert "script-src 'sha256-" in policy
    assert "unsafe-inline" not in policy.partition("script-src")[2].partition(";")[0]
    assert client.of_run(FIRST, "report/figures/images.pdf").headers["content-type"] == (
        "application/pdf"
    )


@pytest.mark.parametrize(
    "path",
    [
        "run.json",
        "journal.jsonl",
        "report/../run.json",
        "report/%2e%2e/run.json",
        "report/..%2f..%2f20261102-second%2frun.json",
        "report//etc/passwd",
        "report/figures",
        "report/link.html",
        "report/out/secret.html",
        "report/report.html%00.png",
        "report/absent.html",
    ],
)
def test_nothing_else_of_the_disk_is_served(client: Client, runs: Path, path: str) -> None:
    """Neither what is no report's nor what a link or dots lead to."""
    secret = runs.parent / "secret.html"
    secret.write_text("secret", "utf-8")
    (runs / FIRST / "report" / "link.html").symlink_to(secret)
    (runs / FIRST / "report" / "out").symlink_to(runs.parent)
    found = client.of_run(FIRST, path)
    assert found.status == 404
    assert "secret" not in found.text


def test_a_link_among_the_runs_is_none_of_them(client: Client, runs: Path) -> None:
    """It may lead anywhere."""
    (runs / "linked").symlink_to(runs / FIRST)
    assert "linked" not in client.get("").text
    assert client.of_run("linked", "report/report.html").status == 404


@pytest.mark.parametrize(
    ("path", "headers"),
    [
        ("/wrong/", {}),
        ("/", {}),
        (f"/{TOKEN}/", {"Host": "elsewhere.example"}),
        (f"/{TOKEN}/", {"Origin": "http://elsewhere.example"}),
    ],
)
def test_strangers_are_refused(client: Client, path: str, headers: dict[str, str]) -> None:
    """Without the token, at another host's name, from another's page."""
    assert client.get(path, whole=True, **headers).status == 403


def test_looking_changes_nothing(client: Client, runs: Path) -> None:
    """Every file is as it was, and there is none more; nothing can be sent."""

    def state() -> dict[Path, tuple[int, int]]:
        found = [runs, *runs.rglob("*")]
        return {each: (each.stat().st_mtime_ns, each.stat().st_size) for each in found}

    before = state()
    assert client.of_run(FIRST, "report/report.html").status == 200
    for page in PAGES:
        assert client.get(page).status == 200
        for method in ("POST", "PUT", "DELETE"):
            origin = client.address.removesuffix(f"/{TOKEN}/")
            assert client.get(page, method=method, Origin=origin).status == 405
    assert state() == before


def test_the_address_of_a_report_tells_nothing_of_the_token(client: Client) -> None:
    """Its key opens the files of its run and nothing else; the token opens no file."""
    link = client.get("").text.split('href="../')[1].partition('"')[0]
    key = link.partition("/")[0]
    assert TOKEN not in link
    assert client.get(f"/{link}", whole=True).status == 200
    assert client.get(f"/{key}/", whole=True).status == 403
    assert client.get(f"/{key}/run/{FIRST}/report/report.html", whole=True).status == 403
    assert client.get(f"run/{FIRST}/report/report.html").status == 403


def test_what_a_report_says_was_missed_stands_beside_the_advice(runs: Path) -> None:
    """A gel may be kept whose run did not pass."""
    summary = runs / SECOND / "report" / "summary.json"
    missed = {"name": "contact_residual", "passed": False, "limit": "<= 0.3"}
    content = json.loads(summary.read_text("utf-8"))
    summary.write_text(json.dumps(content | {"passed": False, "criteria": [missed]}), "utf-8")
    with served(runs) as client:
        page = client.get(f"compare?a={FIRST}&b={SECOND}").text
    assert "not passed" in page
    assert "contact residual; required: &lt;= 0.3" in page


def test_commands_can_be_pasted_into_a_shell(runs: Path) -> None:
    """A folder's name may hold what a shell would run."""
    (runs / ABORTED).rename(runs / "a; touch b")
    with served(runs) as client:
        assert "resume &#39;" in client.get("").text


@pytest.mark.parametrize("content", ["{}", '{"passed": 1, "verdict": ""}', "[" * 10_000])
def test_a_run_whose_summary_is_none_does_not_hide_the_others(runs: Path, content: str) -> None:
    """It is listed with its reason."""
    (runs / FIRST / "report" / "summary.json").write_text(content, "utf-8")
    with served(runs) as client:
        page = client.get("").text
    assert f"{FIRST}/report/summary.json" in page
    assert f"/run/{SECOND}/report/report.html" in page


def test_one_run_alone_is_shown_alone(runs: Path) -> None:
    """Its neighbours are neither listed nor served."""
    with served(runs, only=FIRST) as client:
        assert SECOND not in client.get("").text
        assert client.of_run(SECOND, "report/report.html").status == 404


def test_in_a_browser_by_keyboard_and_on_a_phone(client: Client, chromium: Any) -> None:
    """The list opens a report, and two runs are compared; nothing is wider than the screen."""
    wrong: list[str] = []
    page = chromium.new_page(viewport={"width": 390, "height": 700})
    page.on("console", lambda message: wrong.append(message.text))
    page.goto(client.address)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    page.keyboard.press("Tab")
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    page.wait_for_url("**/compare")
    page.select_option("select[name=a]", FIRST)
    page.select_option("select[name=b]", SECOND)
    page.press("button", "Enter")
    page.wait_for_selector("text=replace the gel")
    page.goto(client.address)
    page.click('a:text-is("report") >> nth=0')
    page.wait_for_url("**/report.html")
    assert page.title() == "report"
    page.close()
    (blocked,) = wrong  # the script of that report is none of this program's
    assert "Content Security Policy" in blocked


def test_a_run_alone_is_found_in_its_folder(runs: Path) -> None:
    """The folder around it, and its name."""
    assert folder_of_runs(runs) == (runs, "")
    assert folder_of_runs(runs / NAMES[0]) == (runs, NAMES[0])


@pytest.mark.parametrize(("name", "word"), [("absent", "no such folder"), ("notes", "no run")])
def test_where_no_run_lies_the_remedy_is_told(runs: Path, name: str, word: str) -> None:
    """What is wrong, and which command makes a run."""
    with pytest.raises(ConfigError, match=word) as caught:
        folder_of_runs(runs / name)
    assert "tacauchy-rig" in caught.value.remedy


def test_presses_of_a_sensor_that_was_wrong_afterwards_are_not_counted(tmp_path: Path) -> None:
    """They passed, and are to be pressed again."""
    store = empty_run(tmp_path)
    keep(store, *pressed(RIGHT))
    assert find_runs(tmp_path)[0].passed_count == 6
    weigh(store, 0.8)
    (found,) = find_runs(tmp_path)
    assert (found.passed_count, found.forces_n) == (0, None)
    assert found.next_command.startswith("tacauchy-rig resume")


def listed(name: str, *met: bool) -> ListedRun:
    """Return a run whose presses met one criterion or did not, and all met another."""
    trials = [
        {
            "index": k,
            "criteria": [
                {"name": "force_margin", "passed": passed},
                {"name": "press", "passed": True},
            ],
        }
        for k, passed in enumerate(met, 1)
    ]
    return ListedRun(name=name, folder=Path(name), summary={"trials": trials, "criteria": "?"})


def test_criteria_that_differ_are_named() -> None:
    """With in how many presses each was met; what both met is left out."""
    assert differing(listed("a", True, True), listed("b", True, False)) == [
        ("force margin", "met in 2 of 2", "met in 1 of 2")
    ]
    assert differing(listed("a", True), listed("b", True, True)) == []
