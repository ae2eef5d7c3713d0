from service.object_keys import (
    JOBS,
    captured_key,
    describe_inputs,
    inputs_key,
    job_key,
    results_key,
)


def test_all_of_a_job_lies_below_its_key() -> None:
    below = [inputs_key("a", "flash"), results_key("a", 2, "a.png"), captured_key("a", 2, "flash")]
    assert below == ["jobs/a/inputs/flash", "jobs/a/2/a.png", "jobs/a/inputs/2/flash"]
    assert job_key("a") == "jobs/a/"
    assert job_key("a").startswith(JOBS)


def test_without_a_name_the_keys_are_the_prefixes_of_one_attempt() -> None:
    assert results_key("a", 2) == "jobs/a/2/"
    assert captured_key("a", 2) == "jobs/a/inputs/2/"


def test_inputs_are_described_by_key_and_digest_of_each_frame() -> None:
    assert describe_inputs("a", {"no_flash": "12", "flash": "34"}) == {
        "no_flash": {"key": "jobs/a/inputs/no_flash", "sha256": "12"},
        "flash": {"key": "jobs/a/inputs/flash", "sha256": "34"},
    }
