"""From captions to instructions: what is dropped and why, rules and language models, stopping and going on."""

import json
import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
import pytest

from agents import cli
from agents.texts import rules
from agents.texts.endpoint import KEY_VARIABLE, ChatEndpoint, EndpointError
from agents.texts.filter import FilterRules, filter_stage
from agents.texts.judge import Rewriter, Scorer, each_alone, read_score
from agents.texts.lines import read_records, run_stage
from agents.texts.sentences import count_tokens, sentence_vector


def write(path, texts):
    path.write_text("".join(json.dumps({"text": text, "id": i}) + "\n" for i, text in enumerate(texts)))
    return path


@contextmanager
def language_model(replies):
    """A server that gives these replies in turn: a text as an answer, a number as an error, bytes as they are."""
    requests = []
    waiting = list(replies)

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self):
            body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
            requests.append((self.path, dict(self.headers), body))
            reply = waiting.pop(0)
            content = reply if isinstance(reply, bytes) else b"no"
            if isinstance(reply, str):
                content = json.dumps({"choices": [{"message": {"role": "assistant", "content": reply}}]}).encode()
            self.send_response(reply if isinstance(reply, int) else 200)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, *arguments):
            """Nothing: the test's output stays clean."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.01,))
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/v1", requests
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


# Files


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('{"text": "wave"}\n\n{"text": "kick\n', r"Line 3 of '.*' is no JSON"),
        ('{"text": "wave"}\n["kick"]\n', r'Line 2 of .* must be a JSON object with a "text"'),
        ('{"caption": "wave"}\n', r"Line 1 of"),
    ],
)
def test_a_bad_line_is_named(tmp_path, content, message):
    (tmp_path / "in.jsonl").write_text(content)
    with pytest.raises(ValueError, match=message):
        read_records(tmp_path / "in.jsonl")
    with pytest.raises(FileNotFoundError, match="JSON object a line"):
        read_records(tmp_path / "none.jsonl")


def test_a_stopped_stage_goes_on_behind_the_last_whole_line(tmp_path):
    # A line separator of Unicode within a text ends no line.
    source, output = write(tmp_path / "in.jsonl", ["a\u2028", "b", "c", "d"]), tmp_path / "deep" / "out.jsonl"
    seen = []

    def shout(record):
        seen.append(record["text"])
        if len(seen) == 3:
            raise KeyboardInterrupt
        return record | {"text": record["text"].upper()}

    with pytest.raises(KeyboardInterrupt):
        run_stage(source, output, {"stage": "shout"}, each_alone(shout))
    with output.open("a") as file:
        file.write('{"text": "C", "so')
    records = run_stage(source, output, {"stage": "shout"}, each_alone(shout))
    assert seen == ["a\u2028", "b", "c", "c", "d"]
    assert [(each["text"], each["source"], each["id"]) for each in records] == [
        ("A\u2028", "a\u2028", 0), ("B", "b", 1), ("C", "c", 2), ("D", "d", 3)
    ]  # fmt: skip
    assert read_records(output) == records
    with pytest.raises(ValueError, match="other options"):
        run_stage(source, output, {"stage": "whisper"}, each_alone(shout))
    with pytest.raises(ValueError, match="another source"):
        run_stage(write(tmp_path / "b.jsonl", ["a", "x", "c", "d"]), output, {"stage": "shout"}, each_alone(shout))
    with pytest.raises(ValueError, match="both source and output"):
        run_stage(source, source, {}, each_alone(shout))


# Filter


def test_the_filter_drops_short_long_and_repeated_captions(tmp_path):
    texts = [
        "wave",
        "a person raises both arms above the head",
        "A person raises  both arms above the head.",
        "a person kicks with the left leg",
        "walk and " * 40,
    ]
    source, output = write(tmp_path / "in.jsonl", texts), tmp_path / "out.jsonl"
    stage = filter_stage(FilterRules())
    records = run_stage(source, output, {}, stage)
    reasons = [each.get("dropped", "") for each in records]
    assert reasons[0] == "1 tokens, fewer than 3"
    assert reasons[1] == reasons[3] == ""
    assert "'a person raises both arms above the head'" in reasons[2]
    assert reasons[4] == "80 tokens, more than 77"
    # Going on finds duplicates of what was kept before.
    output.write_text("".join(line + "\n" for line in output.read_text().splitlines()[:2]))
    assert run_stage(source, output, {}, stage) == records
    with pytest.raises(ValueError, match="in order"):
        FilterRules(fewest_tokens=9, most_tokens=3)


def test_sentence_vectors_know_paraphrases():
    arms, lifted, kick = map(sentence_vector, ["raise both arms", "lift both of your arms up", "kick a ball"])
    assert arms.shape == (384,) and np.linalg.norm(arms) == pytest.approx(1, abs=1e-5)
    assert arms @ lifted > 0.7 > 0.5 > arms @ kick
    assert count_tokens("raise both arms") == 3


# Rules


@pytest.mark.parametrize(
    ("caption", "instruction"),
    [
        ("a person takes a bow", "bow"),
        ("a person raises both arms above their head and then lowers them", "raise both arms above the head"),
        ("The man is walking in a circle quickly", "walk in a circle"),
        ("she slowly walks to the door, then opens it", "walk to the door"),
        ("a walking man turns around", "turn around"),
        ("waving its arms up and down in a flying motion", "wave the arms up and down"),
        ("a person lifts their right arm to their face and scratches nose with fingers", "lift the right arm"),
        ("steps backward with the left foot and extends right hand", "step backward with the left foot"),
        ("a person is doing squats", "squat"),
        ("fold one arm over the other", "fold one arm over the other"),
        ("kneeling", "kneel"),
        ("raise both arms", "raise both arms"),
    ],
)
def test_captions_become_instructions_by_rules(caption, instruction):
    assert rules.rewrite(caption) == instruction
    assert rules.faults(instruction) == []
    assert rules.rewrite(instruction) == instruction


@pytest.mark.parametrize(
    ("instruction", "fault"),
    [
        ("", "empty"),
        ("hi", "imperative"),
        ("walks forward", "imperative"),
        ("raise the right arm of the man", "names somebody"),
        ("walk and jump", "more than one verb"),
        ("walk slowly", "adverbs"),
        ("wave with a smile", "face or fingers"),
        ("bend the left knee and put both hands down", "9 words"),
    ],
)
def test_faults_are_found(instruction, fault):
    assert any(fault in each for each in rules.faults(instruction))


def test_rules_rank_captions_as_people_would():
    plain = [
        "raise both arms",
        "the man waves his right hand",
        "someone walks forward and then turns around",
        "a man walks in a circle, then sits down, gets up again and waves at somebody quickly",
    ]
    scores = [rules.score_plainness(text) for text in plain]
    assert scores == sorted(scores, reverse=True) and scores[0] == 10 and scores[-1] == 0
    clear = ["raise both arms above the head", "raise an arm", "do yoga"]
    scores = [rules.score_clearness(text) for text in clear]
    assert scores == sorted(scores, reverse=True) and scores[0] == 10 and scores[-1] == 0


# Language models


def test_an_endpoint_is_asked_as_openai_compatible_servers_expect(monkeypatch):
    monkeypatch.delenv(KEY_VARIABLE, raising=False)
    with language_model([" wave \n", "kick"]) as (address, requests):
        assert ChatEndpoint(address, "tiny").ask("Be brief.", "Hello") == "wave"
        monkeypatch.setenv(KEY_VARIABLE, "secret")
        assert ChatEndpoint(address + "/", "tiny").ask("Be brief.", "Hello") == "kick"
    path, headers, body = requests[0]
    assert path == requests[1][0] == "/v1/chat/completions"
    assert body["model"] == "tiny" and body["temperature"] == 0
    assert body["messages"] == [{"role": "system", "content": "Be brief."}, {"role": "user", "content": "Hello"}]
    assert "Authorization" not in headers and requests[1][1]["Authorization"] == "Bearer secret"


def test_a_busy_server_is_asked_again_and_a_refusal_is_told(monkeypatch):
    with language_model([503, 429, "wave"]) as (address, requests):
        assert ChatEndpoint(address, "tiny", first_wait=0.01).ask("", "") == "wave"
        assert len(requests) == 3
    for replies, message in [
        ([401], "ANYSKILL_API_KEY"),
        ([404], "usually ends in /v1"),
        ([500, 500], "code 500"),
        ([b"<html>hello</html>"], "does not answer as an OpenAI-compatible endpoint does: <html>"),
        ([b'{"choices": []}'], "OpenAI-compatible"),
    ]:
        with language_model(replies) as (address, _), pytest.raises(EndpointError, match=message):
            ChatEndpoint(address, "tiny", tries=2, first_wait=0.01).ask("", "")


def test_an_unreachable_endpoint_is_one_clear_sentence(tmp_path, capsys):
    with language_model([]) as (address, _):
        pass  # now nobody listens there
    with pytest.raises(EndpointError, match="No language model answers at .*Start the server"):
        ChatEndpoint(address, "tiny", tries=2, first_wait=0.01).ask("", "")
    with pytest.raises(EndpointError, match="begin with http"):
        ChatEndpoint("localhost:8000", "tiny")
    source = write(tmp_path / "in.jsonl", ["wave the right hand"])
    words = ["texts", "score", str(source), str(tmp_path / "out.jsonl"), "--endpoint", address]
    assert cli.main(words) == 2
    assert "give --model" in capsys.readouterr().err
    assert cli.main([*words[:4], "--model", "tiny"]) == 2
    assert "--model tiny needs the --endpoint" in capsys.readouterr().err


def test_a_model_scores_by_both_criteria():
    replies = ['{"score": 9}', 'Sure! {"score": 8}', "9", '{"score": 2}', "I cannot"]
    with language_model(replies) as (address, requests):
        scorer = Scorer(ChatEndpoint(address, "tiny"), least=6)
        good, poor, odd = (scorer({"text": text}) for text in ("squat down", "do yoga", "hi"))
    assert good == {"text": "squat down", "scores": {"plainness": 9, "clearness": 8}}
    assert poor["dropped"] == "clearness 2, less than 6"
    assert odd["dropped"] == "no score for plainness in the answer 'I cannot'"
    assert "PLAIN" in requests[0][2]["messages"][0]["content"]
    assert "CLEAR" in requests[1][2]["messages"][0]["content"]
    assert read_score('{"score": 11}') is None and read_score("7.5") == 7.5
    with pytest.raises(ValueError, match="least"):
        Scorer(None, 11)


def test_a_model_is_told_which_rules_it_broke():
    replies = ["The man bends forward.", '"Bend forward at a right angle."', *["do it very gracefully"] * 3]
    with language_model(replies) as (address, requests):
        rewriter = Rewriter(ChatEndpoint(address, "tiny"))
        good, bad = rewriter({"text": "a man bows"}), rewriter({"text": "a swan"})
    assert good == {"text": "bend forward at a right angle", "rewritten_from": "a man bows"}
    told = requests[1][2]["messages"][1]["content"]
    assert "the man bends forward" in told and "names somebody (man)" in told
    assert "breaks rules: it has adjectives or adverbs (very, gracefully)" in bad["dropped"]


# All together


def test_the_three_commands_in_a_row(tmp_path, capsys):
    texts = ["a person waves the right hand", "wave", "a person waves the right hand!", "the man does yoga at home"]
    files = [write(tmp_path / "0.jsonl", texts), *(tmp_path / f"{i}.jsonl" for i in (1, 2, 3))]
    for stage, source, output in zip(("filter", "score", "rewrite"), files, files[1:], strict=False):
        assert cli.main(["texts", stage, str(source), str(output), "--no-progress"]) == 0
    assert "1 of 4 texts are left" in capsys.readouterr().out
    records = read_records(files[-1])
    assert [record["id"] for record in records] == [0, 1, 2, 3]
    assert records[0]["text"] == "wave the right hand"
    assert records[0]["source"] == records[0]["rewritten_from"] == texts[0]
    assert all("dropped" in record for record in records[1:])
    assert "clearness" in records[3]["dropped"]
