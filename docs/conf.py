"""How the pages become a site: make docs."""

project = "lightlayers"
html_title = "lightlayers"
html_theme = "furo"
extensions = ["myst_parser"]
myst_heading_anchors = 3
html_copy_source = False
html_show_sphinx = False
