"""Stories of the site: run when it is built, so here only how they are run and what they show."""

import json
import re
from pathlib import Path
from types import SimpleNamespace

import pytest
import stories

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGE = """# A story

```sh
echo one > kept.txt
cat kept.txt
```

```python
print(open("kept.txt").read(), "two")
```

```toml
three = 3
```
"""


def test_answers_stand_below_their_commands(tmp_path):
    (tmp_path / "stories").mkdir()
    page = tmp_path / "stories" / "page.md"
    page.write_text(PAGE, encoding="utf-8")
    (tmp_path / "faq.md").write_text("```sh\ntrue\n```\n", encoding="utf-8")
    for job in stories.jobs(tmp_path):
        job()
    kept = tmp_path / "generated" / "stories" / "page" / "answers.json"
    assert json.loads(kept.read_text(encoding="utf-8")) == ["one", "one\n two"]
    source = [PAGE]
    stories.answered(SimpleNamespace(srcdir=tmp_path), "stories/page", source)
    assert "cat kept.txt\n```\n\n```text\none\n```\n" in source[0]
    assert source[0].count("```text") == 2
    other = [PAGE]
    stories.answered(SimpleNamespace(srcdir=tmp_path), "start", other)
    assert other == [PAGE]


def test_a_command_that_fails_fails_the_build(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("```sh\necho before\nfalse\n```\n", encoding="utf-8")
    with pytest.raises(RuntimeError, match="before"):
        stories.run(page, tmp_path)


@pytest.mark.parametrize("page", stories.pages(DOCS), ids=lambda page: page.stem)
def test_pictures_of_a_story_are_made_by_it(page):
    text = page.read_text(encoding="utf-8")
    code = "".join(block for _, block in stories.BLOCK.findall(text))
    shown = re.findall(rf"generated/stories/{page.stem}/([\w.]+)\)", text)
    assert shown or page.stem == "faq"
    assert all(name in code for name in shown)
    assert all(re.match(r"spacearm|cat|import", line) for _, line in stories.BLOCK.findall(text))
