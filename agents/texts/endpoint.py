"""A language model behind an OpenAI-compatible address, over plain HTTP."""

from __future__ import annotations

import json
import os
import time
import urllib.error
import urllib.request
from dataclasses import dataclass
from http.client import HTTPException
from typing import Any

KEY_VARIABLE = "ANYSKILL_API_KEY"
"""Environment variable that may hold the key. Keys for other services are never sent to an address they are not meant for."""
_WORTH_ANOTHER_TRY = (429, 500, 502, 503, 504)
_LONGEST_WAIT = 60.0


class EndpointError(ValueError):
    """The language model cannot be asked, or its answer is of no use; the message says what to do."""


@dataclass(frozen=True)
class ChatEndpoint:
    """Asks a model through `POST <address>/chat/completions`, which local servers and hosted ones understand.

    Attributes:
        address: Such as "http://localhost:8000/v1".
        model: Name of the model there.
        tries: How often a busy or failing server is asked before giving up.
        first_wait: Seconds before the second try; each further one waits twice as long.
        timeout: Seconds after which a server that says nothing counts as gone.
    """

    address: str
    model: str
    tries: int = 4
    first_wait: float = 1.0
    timeout: float = 120.0

    def __post_init__(self) -> None:
        if not self.address.startswith(("http://", "https://")):
            raise EndpointError(f"The endpoint must begin with http:// or https://, got {self.address!r}.")
        if not self.model:
            raise EndpointError("An endpoint needs the name of a model: give --model.")
        if self.tries < 1:
            raise EndpointError(f"tries must be at least 1, got {self.tries}.")

    def ask(self, instruction: str, question: str) -> str:
        """The model's answer, without blanks around it.

        Args:
            instruction: The system prompt.
            question: What the user says.

        Raises:
            EndpointError: It cannot be reached, refuses, or answers in another form.
        """
        body = {
            "model": self.model,
            "messages": [{"role": "system", "content": instruction}, {"role": "user", "content": question}],
            "temperature": 0.0,
        }
        reply = self._post(json.dumps(body).encode())
        try:
            answer = json.loads(reply)["choices"][0]["message"]["content"]
        except (ValueError, KeyError, IndexError, TypeError):
            answer = None
        if not isinstance(answer, str):
            raise EndpointError(
                f"{self._url} does not answer as an OpenAI-compatible endpoint does: {reply[:120].decode(errors='replace')}"
            )
        return answer.strip()

    @property
    def _url(self) -> str:
        return self.address.rstrip("/") + "/chat/completions"

    def _post(self, body: bytes) -> bytes:
        headers = {"Content-Type": "application/json"}
        if os.environ.get(KEY_VARIABLE):
            headers["Authorization"] = f"Bearer {os.environ[KEY_VARIABLE]}"
        wait = self.first_wait
        for remaining in reversed(range(self.tries)):
            request = urllib.request.Request(self._url, body, headers)
            try:
                with urllib.request.urlopen(request, timeout=self.timeout) as response:
                    content: bytes = response.read()
                    return content
            except urllib.error.HTTPError as error:
                if error.code not in _WORTH_ANOTHER_TRY or not remaining:
                    raise EndpointError(self._refusal(error)) from error
                time.sleep(min(_seconds(error.headers.get("Retry-After"), wait), _LONGEST_WAIT))
            except (OSError, HTTPException) as error:
                if not remaining:
                    reason = getattr(error, "reason", error)
                    raise EndpointError(
                        f"No language model answers at {self._url} ({reason}). Start the server, correct --endpoint, or leave "
                        "it out for the rules that work offline."
                    ) from error
                time.sleep(wait)
            wait *= 2
        raise AssertionError("the last try has returned or raised")

    def _refusal(self, error: urllib.error.HTTPError) -> str:
        told = error.read(300).decode(errors="replace").strip()
        advice = {
            401: f"set the key in the environment variable {KEY_VARIABLE}",
            403: f"set a key that may use this model in {KEY_VARIABLE}",
            404: "check --endpoint (it usually ends in /v1) and --model",
            429: "it is too busy; go on later with the same command",
        }.get(error.code, "the same command goes on when it works again")
        return f"{self._url} refuses with code {error.code}: {advice}. It says: {told or 'nothing'}"


def _seconds(header: Any, otherwise: float) -> float:
    try:
        return max(0.0, float(header))
    except (TypeError, ValueError):
        return otherwise
