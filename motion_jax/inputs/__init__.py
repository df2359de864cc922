"""How what people give is read and checked: files, texts, numbers, settings; and how it is told what is wrong."""
