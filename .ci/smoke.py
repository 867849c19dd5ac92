"""Start the console headless, wait until it is usable, command it, and stop it: what a first user's minute looks like."""

import json
import signal
import socket
import subprocess
import sys
import time
import urllib.request

with socket.socket() as probe:
    probe.bind(("127.0.0.1", 0))
    port = probe.getsockname()[1]
base = f"http://127.0.0.1:{port}"


def call(method: str, path: str, body: dict | None = None) -> dict:
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(base + path, data, {"Content-Type": "application/json"}, method=method)
    with urllib.request.urlopen(request, timeout=30) as answer:
        return json.load(answer)


server = subprocess.Popen([sys.executable, "-m", "server", "--port", str(port), "--no-browser"])
try:
    for _ in range(3000):
        assert server.poll() is None, "the console ended at start"
        try:
            health = call("GET", "/api/v1/health")
            break
        except OSError:
            time.sleep(0.1)
    else:
        raise AssertionError("the console did not answer within 300 s: a first start compiles the kernels")
    print("health:", health)
    with urllib.request.urlopen(base + "/") as page:
        assert b"Forcelens" in page.read()
    with urllib.request.urlopen(base + "/viser/") as page:
        assert page.status == 200
    call("PATCH", "/api/v1/command", {"mask": [0, 0, 1], "force_n": [0, 0, 5]})
    before = call("GET", "/api/v1/state")
    time.sleep(2)
    after = call("GET", "/api/v1/state")
    assert after["time_s"] > before["time_s"] + 0.5, "simulated time stands still"
    assert after["base"]["position_m"][2] > 0.25, "the robot does not stand"
    assert after["command"]["mask"] == [0, 0, 1]
finally:
    server.send_signal(signal.SIGINT)
    code = server.wait(timeout=60)
assert code == 0, f"the console ended with status {code}"
print("smoke run: ok")
