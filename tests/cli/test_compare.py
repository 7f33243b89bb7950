"""schuler compare as typed."""

import pytest


@pytest.fixture(scope="module")
def folders(tmp_path_factory, program):
    place = tmp_path_factory.mktemp("compare")
    assert program("demo", "--out", "one", cwd=place).status == 0
    assert program("demo", "--out", "two", "--seed", 2, cwd=place).status == 0
    return place


def test_figures_on_the_terminal_and_a_page_beside(folders, program):
    done = program("compare", "one", "two", cwd=folders)
    assert done.status == 0, done.err
    assert "demo (one)" in done.out and "demo (two)" in done.out and "*" in done.out
    page = (folders / "compare.html").read_text()
    assert 'id="fig-map"' in page and 'id="fig-differences"' in page and 'id="fig-sigma"' in page
    assert "the same study file, other in the seed" in page
    assert sorted(p.name for p in (folders / "one").iterdir())[0] == "report.html"  # nothing was put into it


def test_the_page_goes_where_it_is_told_and_replaces_only_a_page_of_ours(folders, program):
    assert program("compare", "one", "--out", "pages", cwd=folders).status == 0
    assert (folders / "pages" / "compare.html").is_file()
    assert program("compare", "one", "two", "--out", "pages/both.html", cwd=folders).status == 0
    assert program("compare", "two", "--out", "pages/both.html", cwd=folders).status == 0
    (folders / "mine.html").write_text("<p>my own</p>")
    done = program("compare", "one", "--out", "mine.html", cwd=folders)
    assert done.status == 1 and "not a page of schuler" in done.err
    assert (folders / "mine.html").read_text() == "<p>my own</p>"
    done = program("compare", "one", "--out", "mine.html/x.html", cwd=folders)
    assert done.status == 1 and "in the way" in done.err


def test_what_is_no_result_folder_gets_a_sentence_each(folders, program):
    done = program("compare", "one", "nowhere", "one/summary.json", cwd=folders)
    assert done.status == 1 and len(done.err.strip().splitlines()) == 2
    assert "nowhere: there is no such folder" in done.err and "type one" in done.err
    assert program("compare", cwd=folders).status == 2
