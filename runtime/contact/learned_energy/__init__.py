"""The learned energy of condensed contact: how a dent hardens, with exact derivatives."""
