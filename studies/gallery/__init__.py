"""The paper's figures and tables, and the planes of stability and regimes beside them."""
