// Trades the token for a session that scripts cannot read.
const form = document.getElementById("login");
const error = document.getElementById("error");

form.addEventListener("submit", async (event) => {
  event.preventDefault();
  error.textContent = "";
  const token = document.getElementById("token").value;
  try {
    const answer = await fetch("api/v1/login", {
      method: "POST",
      headers: { "Content-Type": "application/json", "X-Radard": "1" },
      body: JSON.stringify({ token }),
    });
    if (answer.ok) {
      location.reload();
      return;
    }
    error.textContent = (await answer.json()).error;
  } catch {
    error.textContent = "the radar does not answer";
  }
});
