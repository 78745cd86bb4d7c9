// The part of the address behind the "#" names a view of the dashboard: signing in leads there.
document.querySelector("form").action = `/login${location.hash}`;
